import numpy as np


def rotation(a):
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


def likelihood_field_range_finder_model(z, beams, pose, laser, field, cell, z_hit, z_rand, sigma, zmax):
    p = np.ones(z.shape, np.float32)
    good = z < zmax
    ends = z[good] * np.stack([np.cos(beams[good]), np.sin(beams[good])])
    in_robot = rotation(laser[2]) @ ends + laser[:2, None]
    in_map = rotation(pose[2]) @ in_robot + pose[:2, None]
    j, i = (in_map // cell).astype(np.int32)
    d = field.astype(np.float32)[i, j]
    p[good] = z_hit * np.exp(-0.5 * np.square(d / sigma)) / (sigma * np.sqrt(2 * np.pi)) + z_rand / zmax
    return p
