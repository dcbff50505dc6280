import math


def likelihood_field_range_finder_model(
    ranges, angles, pose, laser, distances, resolution, z_hit, z_rand, sigma_hit, max_range
):
    x, y, theta = pose
    q = []
    for z, angle in zip(ranges, angles, strict=True):
        if z >= max_range:
            q.append(1.0)
            continue
        end_x = x + laser[0] * math.cos(theta) - laser[1] * math.sin(theta) + z * math.cos(theta + laser[2] + angle)
        end_y = y + laser[1] * math.cos(theta) + laser[0] * math.sin(theta) + z * math.sin(theta + laser[2] + angle)
        distance = distances[int(end_y / resolution), int(end_x / resolution)]
        hit = math.exp(-(distance**2) / (2 * sigma_hit**2)) / (math.sqrt(2 * math.pi) * sigma_hit)
        q.append(z_hit * hit + z_rand / max_range)
    return q
