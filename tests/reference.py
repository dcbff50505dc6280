"""The slow, obvious twin of every kernel and formula: plain Python and NumPy, written from the books."""

from __future__ import annotations

import itertools
import math

import numpy as np
import scipy.linalg

# --- random numbers --------------------------------------------------------------------------------------------------

_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15


def random_bits(key: int, index: int) -> int:
    """SplitMix64 with Python's unbounded integers: 64 bits from a key and a counter."""
    z = (int(key) + (index + 1) * _GOLDEN) & _MASK
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return z ^ (z >> 31)


def uniforms(key: int, n: int) -> np.ndarray:
    """The upper 53 bits as a fraction."""
    return np.array([(random_bits(key, i) >> 11) / 2**53 for i in range(n)])


# --- true ranges -----------------------------------------------------------------------------------------------------


def ray(opaque, x: float, y: float, angle: float, max_range: float) -> tuple[float, int]:
    """Every border of the grid that the ray crosses, sorted; the middle of each piece tells the cell it lies in.

    Returns (range in cells, value of the cell that stops the ray); (inf, 0) where none does.
    """
    height, width = opaque.shape
    if not (0 <= x < width and 0 <= y < height):
        return math.inf, 0
    if opaque[int(y), int(x)]:
        return 0.0, int(opaque[int(y), int(x)])
    direction = math.cos(angle), math.sin(angle)
    crossings = [np.zeros(1)]
    for start, slope, borders in ((x, direction[0], width), (y, direction[1], height)):
        if slope != 0.0:
            crossings.append((np.arange(borders + 1) - start) / slope)
    at = np.sort(np.concatenate(crossings))
    at = at[at >= 0.0]
    for near, far in itertools.pairwise(at):
        middle = (near + far) / 2
        col, row = math.floor(x + middle * direction[0]), math.floor(y + middle * direction[1])
        if near > max_range or not (0 <= col < width and 0 <= row < height):
            break
        if opaque[row, col]:
            return float(near), int(opaque[row, col])
    return math.inf, 0


def line(col: int, row: int, end_col: int, end_row: int) -> list[tuple[int, int]]:
    """Bresenham's cells by rounding: one for each step of the longer axis, halves rounded away from the start."""
    across, up = end_col - col, end_row - row
    long, short = max(abs(across), abs(up)), min(abs(across), abs(up))
    sign = (1 if across >= 0 else -1), (1 if up >= 0 else -1)
    cells = []
    for k in range(long + 1):
        aside = (2 * k * short + long) // (2 * long) if long else 0
        along = (k, aside) if abs(across) >= abs(up) else (aside, k)
        cells.append((col + sign[0] * along[0], row + sign[1] * along[1]))
    return cells


def ray_bresenham(opaque, x: float, y: float, angle: float, max_range: float) -> tuple[float, int]:
    """From cell to cell along Bresenham's line; the range ends at the centre of the cell that stops it."""
    height, width = opaque.shape
    start = math.floor(x), math.floor(y)
    end = math.floor(x + max_range * math.cos(angle)), math.floor(y + max_range * math.sin(angle))
    for col, row in line(*start, *end):
        if not (0 <= col < width and 0 <= row < height):
            break
        if opaque[row, col]:
            return math.dist(start, (col, row)), int(opaque[row, col])
    return math.inf, 0


def around(opaque, x, y, angle, max_range, *, sideways: float, turned: float = 0.0) -> tuple[float, float]:
    """Shortest and longest range of the rays beside this one: what it may see if its place is only roughly known."""
    seen = [
        ray(opaque, x - s * math.sin(a), y + s * math.cos(a), a, max_range)[0]
        for a in (angle - turned, angle, angle + turned)
        for s in (-sideways, 0.0, sideways)
    ]
    return min(seen), max(seen)


def encode(distance: float, kind: int, max_range: float, log_offset: float, hit_codes: int, unknown_codes: int) -> int:
    """The code whose place on the logarithmic scale is nearest; 1 = occupied, anything else is unknown land."""
    if math.isinf(distance):
        return 255
    share = min(math.log(1 + distance / log_offset) / math.log(1 + max_range / log_offset), 1.0)
    first, codes = (0, hit_codes) if kind == 1 else (hit_codes, unknown_codes)
    places = np.arange(codes) / (codes - 1)
    return first + int(np.argmin(np.abs(places - share)))


def clearance(opaque) -> np.ndarray:
    """King's moves from each cell to the nearest opaque one, or to the frame around the map; 0 on both."""
    height, width = opaque.shape
    out = np.zeros((height, width), np.uint8)
    rows, cols = np.nonzero(np.pad(opaque[1:-1, 1:-1], 1, constant_values=1))
    for row in range(1, height - 1):
        for col in range(1, width - 1):
            out[row, col] = np.maximum(np.abs(rows - row), np.abs(cols - col)).min()
    return out


def nearest_squared(wanted) -> np.ndarray:
    """Squared distance in cells from each cell to the nearest wanted one."""
    found = np.argwhere(wanted)
    cells = np.argwhere(np.ones_like(wanted))
    return ((cells[:, None] - found) ** 2).sum(axis=2).min(axis=1).reshape(wanted.shape)


def mix(words, first: int) -> int:
    """Sum of 64-bit words, each stirred with its place, the first of which is given; with unbounded integers."""
    total = 0
    for i, word in enumerate(words, first):
        z = int(word) ^ (i * _GOLDEN & _MASK)
        z = ((z ^ (z >> 32)) * 0xBF58476D1CE4E5B9) & _MASK
        total += z ^ (z >> 29)
    return total & _MASK


# --- motion ----------------------------------------------------------------------------------------------------------


def deviations(rot1: float, trans: float, rot2: float, alphas) -> tuple[float, float, float]:
    """Standard deviations of Table 5.6's three draws, from its lines 5 to 7."""
    a1, a2, a3, a4 = alphas
    return (
        math.sqrt(a1 * rot1**2 + a2 * trans**2),
        math.sqrt(a3 * trans**2 + a4 * rot1**2 + a4 * rot2**2),
        math.sqrt(a1 * rot2**2 + a2 * trans**2),
    )


def move(poses, motion, std, key: int, quantiles) -> np.ndarray:
    """Table 5.6, one particle at a time in double precision: ``poses`` (n, 3) -> (n, 3), yaw in [-pi, pi)."""
    moved = np.empty(poses.shape)
    for i, (x, y, theta) in enumerate(poses.astype(float)):
        bits = random_bits(key, i)
        draws = [float(quantiles[(bits >> shift) & 0xFFFF]) for shift in (0, 16, 32)]
        rot1, trans, rot2 = (m + s * d for m, s, d in zip(motion, std, draws, strict=True))
        moved[i] = x + trans * math.cos(theta + rot1), y + trans * math.sin(theta + rot1), theta + rot1 + rot2
    moved[:, 2] = np.mod(moved[:, 2] + np.pi, 2 * np.pi) - np.pi
    return moved


def move_by(poses, steps, which, key: int, quantiles) -> np.ndarray:
    """One particle at a time: each makes the step, a Gaussian (mean, covariance), that its eight bits choose."""
    moved = np.empty(poses.shape)
    for i, (x, y, theta) in enumerate(poses.astype(float)):
        bits = random_bits(key, i)
        mean, covariance = steps[which[bits >> 56]]
        draws = np.array([float(quantiles[(bits >> shift) & 0xFFFF]) for shift in (0, 16, 32)])
        dx, dy, turn = mean + np.linalg.cholesky(covariance) @ draws
        moved[i] = (
            x + math.cos(theta) * dx - math.sin(theta) * dy,
            y + math.sin(theta) * dx + math.cos(theta) * dy,
            theta + turn,
        )
    moved[:, 2] = np.mod(moved[:, 2] + np.pi, 2 * np.pi) - np.pi
    return moved


def followed(weights, way_of, key: int, ways: int) -> np.ndarray:
    """How much of the weights belongs to the particles that took each way: the top eight of a particle's bits say."""
    took = [way_of[random_bits(key, i) >> 56] for i in range(len(weights))]
    return np.array([sum(w for w, t in zip(weights, took, strict=True) if t == way) for way in range(ways)])


# --- the sensor model ------------------------------------------------------------------------------------------------


def beam_density(z, z_star, max_range, *, hit, short, rand, sigma, rate, long=0.0, long_rate=1.0) -> float:
    """Table 6.1 for one reading that came back, integrals by the error function; z* = inf: nothing stops the ray."""
    density = rand / max_range
    if math.isinf(z_star):
        return density + short * rate * math.exp(-rate * z) / (1 - math.exp(-rate * max_range))

    def below(limit):
        return 0.5 * (1 + math.erf((limit - z_star) / (sigma * math.sqrt(2))))

    density += (
        hit
        * math.exp(-((z - z_star) ** 2) / (2 * sigma**2))
        / math.sqrt(2 * math.pi * sigma**2)
        / (below(max_range) - below(0.0))
    )
    if z <= z_star:
        density += short * rate * math.exp(-rate * z) / (1 - math.exp(-rate * z_star))
    elif long:
        density += (
            long * long_rate * math.exp(-long_rate * (z - z_star)) / (1 - math.exp(-long_rate * (max_range - z_star)))
        )
    return density


def table_place(pose, laser, resolution, headings, row_of_cell) -> tuple[int, int, float]:
    """Row and heading of the table for a robot pose, and how near (cells or headings) it is to another one."""
    x, y, theta = (float(v) for v in pose)
    at = (
        (x + math.cos(theta) * laser[0] - math.sin(theta) * laser[1]) / resolution,
        (y + math.sin(theta) * laser[0] + math.cos(theta) * laser[1]) / resolution,
    )
    turn = (theta + laser[2]) * headings / (2 * math.pi)
    undecided = min(abs(v - round(v)) for v in (*at, turn + 0.5))
    height, width = row_of_cell.shape
    col, row = math.floor(at[0]), math.floor(at[1])
    inside = 0 <= col < width and 0 <= row < height
    return (int(row_of_cell[row, col]) if inside else -1), math.floor(turn + 0.5) % headings, undecided


def score(row: int, heading: int, table, offsets, log_likelihood, outside: float) -> float:
    """Sum over beams of the log-likelihood of what the table says each of them should see; ``table`` unpadded."""
    if row < 0:
        return outside
    headings = table.shape[1]
    return sum(float(log_likelihood[k, table[row, (heading + o) % headings]]) for k, o in enumerate(offsets))


def standing(cell: int, heading: int, laser_in_robot, headings: int, allowed) -> bool:
    """Whether the robot's centre is in an allowed cell when its laser is in the middle of this one; laser in cells."""
    height, width = allowed.shape
    yaw = 2 * math.pi * heading / headings - laser_in_robot[2]
    x = cell % width + 0.5 - math.cos(yaw) * laser_in_robot[0] + math.sin(yaw) * laser_in_robot[1]
    y = cell // width + 0.5 - math.sin(yaw) * laser_in_robot[0] - math.cos(yaw) * laser_in_robot[1]
    return 0 <= x < width and 0 <= y < height and bool(allowed[math.floor(y), math.floor(x)])


# --- the world as the log has shown it -------------------------------------------------------------------------------


def place_in_world(pose, laser, resolution, headings, margin: int, wanted) -> tuple[int | None, int, float]:
    """Cell (-1 off the raster, None where it is not wanted) and heading of the laser, and how near to another one."""
    x, y, theta = (float(v) for v in pose)
    cells = np.arange(wanted.size).reshape(wanted.shape)
    shifted = x + margin * resolution, y + margin * resolution, theta
    cell, heading, undecided = table_place(shifted, laser, resolution, headings, cells)
    return (cell if cell < 0 or wanted.flat[cell] else None), heading, undecided


def longest_in_wall(start, end, margin: int, is_wall) -> float:
    """How many cells long the longest piece is that the way from start to end (cells of the map) has within a wall."""
    height, width = is_wall.shape
    (x, y), length = (v + margin for v in start), math.dist(start, end)
    dx, dy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    crossings = [np.array([0.0, length])]
    for at, slope, borders in ((x, dx, width), (y, dy, height)):
        if slope != 0.0:
            crossings.append((np.arange(borders + 1) - at) / slope)
    at = np.sort(np.concatenate(crossings))
    longest = 0.0
    for near, far in itertools.pairwise(at[(at >= 0.0) & (at <= length)]):
        col, row = math.floor(x + (near + far) / 2 * dx), math.floor(y + (near + far) / 2 * dy)
        if 0 <= col < width and 0 <= row < height and is_wall[row, col]:
            longest = max(longest, far - near)
    return longest


def through_unknown(agnostic, survival, likelihood) -> float:
    """A beam ended in the unknown, or it passed that and met what the map says; never nothing at all."""
    return math.log(max(agnostic + survival * likelihood, 1e-30))


def looked_at(laser, angles, ranges, longest: float, shape, margin: int) -> tuple[set, set]:
    """Cells (row, column) in which beams of a scan ended, and those that beams passed and none ended in.

    Points every two thirds of a cell are looked at, up to 1.5 cells before the end, as long as they are on the raster.
    """
    x, y, yaw = laser
    ended, passed = set(), set()

    def cell(along: float, angle: float) -> tuple[int, int] | None:
        col = math.floor(x + along * math.cos(yaw + angle)) + margin
        row = math.floor(y + along * math.sin(yaw + angle)) + margin
        return (row, col) if 0 <= row < shape[0] and 0 <= col < shape[1] else None

    for angle, reading in zip(angles, ranges.astype(float), strict=True):
        if math.isnan(reading):
            continue
        if reading <= longest:
            ended.add(cell(reading, angle))
        for point in range(int(max(min(reading - 1.5, longest), 0.0) * 1.5)):
            if (at := cell(point / 1.5, angle)) is None:
                break
            passed.add(at)
    return ended - {None}, passed - ended


def counted(hits, passes, ended: set, passed: set, most: float) -> tuple[np.ndarray, np.ndarray]:
    """The counts after one more scan; together at most ``most``, the new one in full before that is seen to."""
    hits, passes = hits.astype(float), passes.astype(float)
    for counts, cells in ((hits, ended), (passes, passed)):
        for at in cells:
            counts[at] += 1.0
    too_many = np.maximum((hits + passes) / most, 1.0)
    return hits / too_many, passes / too_many


# --- likelihood fields -----------------------------------------------------------------------------------------------


def nearest_obstacle(occupied, resolution: float, max_dist: float) -> np.ndarray:
    """Metres from every cell's centre to that of the nearest occupied one, each pair measured; at most max_dist."""
    obstacles = np.argwhere(occupied)
    distances = np.full(occupied.shape, max_dist)
    for cell in np.ndindex(occupied.shape):
        for obstacle in obstacles:
            distances[cell] = min(distances[cell], math.dist(cell, obstacle) * resolution)
    return distances


def beam_ends(pose, laser, angles, ranges) -> list[tuple[float, float]]:
    """Lines 5 and 6 of Table 6.3: where each beam ends on the map, m; of those that came back."""
    x, y, theta = (float(v) for v in pose)
    at_x = x + laser[0] * math.cos(theta) - laser[1] * math.sin(theta)
    at_y = y + laser[1] * math.cos(theta) + laser[0] * math.sin(theta)
    return [
        (at_x + z * math.cos(theta + laser[2] + a), at_y + z * math.sin(theta + laser[2] + a))
        for a, z in zip(angles, ranges, strict=True)
        if math.isfinite(z)
    ]


def end_distances(ends, distances, resolution: float, off_map: float) -> list[float]:
    """The distance of the cell that each end lies in; ``off_map`` where there is none."""
    height, width = distances.shape
    cells = [(math.floor(y / resolution), math.floor(x / resolution)) for x, y in ends]
    return [float(distances[r, c]) if 0 <= r < height and 0 <= c < width else off_map for r, c in cells]


def field_density(distance: float, max_range: float, *, hit: float, rand: float, sigma: float, amcl: bool) -> float:
    """Line 8 of Table 6.3 for one beam, its Gaussian without the factor in front if AMCL's."""
    gauss = math.exp(-(distance**2) / (2 * sigma**2))
    return hit * (gauss if amcl else gauss / math.sqrt(2 * math.pi * sigma**2)) + rand / max_range


def used_beams(distances, skip_distance: float, threshold: float, error_threshold: float) -> list[bool]:
    """AMCL's beam skipping over ``distances`` (particles, beams) m, infinite off the map: which beams are used."""
    n, m = distances.shape
    used = []
    for beam in range(m):
        near = sum(1 for particle in range(n) if distances[particle, beam] < skip_distance)
        used.append(near / n > threshold)
    return [True] * m if used.count(False) >= error_threshold * m else used


# --- resampling ------------------------------------------------------------------------------------------------------


def low_variance(weights, start: float, m: int) -> list[int]:
    """Table 4.4: for every tick of the comb, the first particle whose cumulative weight exceeds it."""
    return [_at(weights, (start + j) / m) for j in range(m)]


def multinomial(weights, uniform_draws) -> list[int]:
    """Each draw on its own."""
    return [_at(weights, u) for u in uniform_draws]


def _at(weights, target: float) -> int:
    cumulative, chosen = 0.0, 0
    for i, weight in enumerate(weights):
        cumulative += weight
        if weight > 0.0:
            chosen = i
        if cumulative > target:
            break
    return chosen


# --- the belief ------------------------------------------------------------------------------------------------------


def bins(poses, weights, size: float, turns: int) -> dict[tuple[int, int, int], tuple[float, list[int]]]:
    """(column, row, turn) -> (weight, indices of the particles), in the order in which particles come upon them."""
    found: dict[tuple[int, int, int], tuple[float, list[int]]] = {}
    for i, (x, y, theta) in enumerate(poses.astype(float)):
        key = math.floor(x / size), math.floor(y / size), math.floor((theta + math.pi) / (2 * math.pi) * turns) % turns
        weight, members = found.get(key, (0.0, []))
        found[key] = weight + weights[i], [*members, i]
    return found


def clusters(found, turns: int, floor: float) -> list[set[tuple[int, int, int]]]:
    """Flood fill over the heavy enough bins, through all 26 neighbours; headings go round."""
    left = {key for key, (weight, _) in found.items() if weight >= floor}
    groups = []
    while left:
        group, edge = set(), [left.pop()]
        while edge:
            col, row, turn = edge.pop()
            group.add((col, row, turn))
            near = {
                (col + i, row + j, (turn + k) % turns) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)
            } & left
            left -= near
            edge.extend(near)
        groups.append(group)
    return groups


def moments(poses, weights) -> tuple[float, np.ndarray, np.ndarray]:
    """Weight, mean and covariance of some particles; headings are unrolled about the first one."""
    poses = poses.astype(float).copy()
    turn = poses[:, 2] - poses[0, 2]
    poses[:, 2] = poses[0, 2] + np.mod(turn + np.pi, 2 * np.pi) - np.pi
    mean = np.average(poses, axis=0, weights=weights)
    covariance = np.cov(poses.T, aweights=weights, bias=True) if len(poses) > 1 else np.zeros((3, 3))
    return float(np.sum(weights)), mean, covariance


# --- hindsight -------------------------------------------------------------------------------------------------------


def predecessor_densities(poses, at, ways, jump: float) -> np.ndarray:
    """How likely each pose (n, 3) led to ``at``: by one of the ``ways`` (move, deviations, share), or by a jump.

    Each way is a Gaussian in the earlier pose's frame, in units of its own peak; so is the jump.
    """
    densities = []
    for x, y, theta in poses.astype(float):
        total = 0.0
        for moved, std, share in ways:
            # Where the move leads from this pose, and how far the other one is from there along its own axes.
            to_x = x + math.cos(theta) * moved[0] - math.sin(theta) * moved[1]
            to_y = y + math.sin(theta) * moved[0] + math.cos(theta) * moved[1]
            off = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]]) @ (
                at[0] - to_x,
                at[1] - to_y,
            )
            errors = off[0] / std[0], off[1] / std[1], math.remainder(at[2] - theta - moved[2], 2 * math.pi) / std[2]
            total += share * (math.exp(-sum(e * e for e in errors) / 2) + jump)
        densities.append(total)
    return np.array(densities)


# --- scans of a moving laser -----------------------------------------------------------------------------------------


def drive(velocity, seconds: float) -> np.ndarray:
    """Where constant velocity (m/s, m/s, rad/s, own frame) leads: the matrix exponential of the twist, 3x3."""
    vx, vy, omega = velocity
    return scipy.linalg.expm(seconds * np.array([[0.0, -omega, vx], [omega, 0.0, vy], [0.0, 0.0, 0.0]]))


def velocity_of(motion) -> np.ndarray:
    """The constant velocity that leads to a pose (m, m, rad) within a second."""
    x, y, turn = motion
    to_pose = np.column_stack([drive((1, 0, turn), 1.0)[:2, 2], drive((0, 1, turn), 1.0)[:2, 2]])
    return np.array([*np.linalg.solve(to_pose, [x, y]), turn])


def carried(ranges, angles, motion) -> list[tuple[float, float] | None]:
    """Of beams in the order of measurement the direction, rad, and range now from the first one's place; None: NaN.

    ``motion`` of the laser from the first beam to the last. Directions are those of the beams, turned by less than pi.
    """
    velocity, found = velocity_of(motion), []
    for i, (z, angle) in enumerate(zip(ranges, angles, strict=True)):
        share = i / (len(ranges) - 1)
        turned = angle + share * motion[2]
        if math.isnan(z):
            found.append(None)
        elif math.isinf(z):
            found.append((turned, math.inf))
        else:
            x, y, _ = drive(velocity, share) @ [z * math.cos(angle), z * math.sin(angle), 1.0]
            found.append((turned + math.remainder(math.atan2(y, x) - turned, 2 * math.pi), math.hypot(x, y)))
    return found


def deskewed(ranges, angles, motion, *, steepest: float, rough: float, widest: float, aside: float):
    """Readings in the regular directions ``angles``, the order of measurement, and how near each is to being another.

    Every pair of neighbours offers readings to the directions between them, and the shortest wins; whoever looks into
    a direction a full turn later is asked only where nobody was before.
    """
    step = angles[1] - angles[0]
    ends = carried(ranges, angles, motion)
    seen = [i for i, end in enumerate(ends) if end is not None]
    offers: list[list[list[float]]] = [[[], []] for _ in angles]
    doubt = np.full(len(angles), math.inf)
    pairs = list(itertools.pairwise([None, *seen, None])) if seen else []
    for a, b in pairs:
        start = ends[b][0] - step / 2 if a is None else ends[a][0]
        stop = ends[a][0] + step / 2 if b is None else ends[b][0]
        r0, r1 = ends[b if a is None else a][1], ends[a if b is None else b][1]
        gap = 1 if a is None or b is None else b - a
        flat = False
        if a is not None and b is not None and math.isfinite(r0) and math.isfinite(r1):
            limit = steepest * gap * abs(step) * min(ranges[a], ranges[b]) + rough
            flat = abs(ranges[a] - ranges[b]) <= limit and (stop - start) / step * abs(step) < widest
            if abs(abs(ranges[a] - ranges[b]) - limit) < 1e-5 or abs(abs(stop - start) - widest) < 1e-6:
                doubt[:] = 0.0
        reach = aside * abs(step) if gap == 1 else (stop - start) / step * abs(step) / (2 * gap)
        for j, lap in itertools.product(range(len(angles)), (0, 1)):
            direction = angles[j] + lap * 2 * math.pi * math.copysign(1.0, step)
            back, on = (direction - start) / step * abs(step), (stop - direction) / step * abs(step)
            doubt[j] = min(doubt[j], abs(back), abs(on), abs(back - on), abs(min(back, on) - reach))
            if not (back >= 0 and on > 0):
                continue
            both_open = gap == 1 and a is not None and b is not None and math.isinf(r0) and math.isinf(r1)
            if flat and (gap == 1 or min(back, on) <= reach):
                offers[j][lap].append(_on_the_line(direction, (start, r0), (stop, r1)))
            elif min(back, on) <= reach or both_open:
                offers[j][lap].append(r0 if back <= on else r1)
    readings = [min(now or again[:1], default=math.nan) for now, again in offers]
    return np.array(readings), doubt


def _on_the_line(direction: float, *polar: tuple[float, float]) -> float:
    """How far the ray goes to the line through two points, by two linear equations."""
    (x0, y0), (x1, y1) = ((r * math.cos(a), r * math.sin(a)) for a, r in polar)
    return float(np.linalg.solve([[math.cos(direction), x0 - x1], [math.sin(direction), y0 - y1]], [x0, y0])[0])


# --- matching --------------------------------------------------------------------------------------------------------


def surfaces(ranges, angles, at, *, longest, window, thickness, spacing, side) -> tuple[np.ndarray, bool]:
    """Points and normals (4, m) of the walls that a scan saw; and whether rounding decides anything about them.

    Neighbours belong together that are linked one by one and near the point; their line is that of the largest
    eigenvalue of their scatter.
    """
    step = abs(angles[1] - angles[0])
    readings = [float(r) if math.isfinite(r) and 0 < r <= longest else None for r in ranges]
    ends = [
        None if r is None else np.array([at[0] + r * math.cos(a), at[1] + r * math.sin(a)])
        for r, a in zip(readings, angles, strict=True)
    ]
    undecided = False

    def within(distance: float, limit: float) -> bool:
        nonlocal undecided
        undecided |= abs(distance - limit) < 1e-6
        return distance <= limit

    def linked(k: int) -> bool:
        if not 0 <= k < len(ends) - 1 or ends[k] is None or ends[k + 1] is None:
            return False
        gap = 0.1 + min(0.4, 3 * step * min(readings[k], readings[k + 1]))
        return within(math.dist(ends[k], ends[k + 1]), gap)

    found, last = [], None
    for k, end in enumerate(ends):
        if end is None or (last is not None and not within(spacing, math.dist(end, last))):
            continue
        group = [k]
        for way in (-1, 1):
            j = k
            while linked(j if way > 0 else j - 1) and abs(j - k) < side:
                if j != k and not within(math.dist(ends[j + way], end), window):
                    break
                j += way
                group.append(j)
        if len(group) < 2:
            continue
        points = np.array([ends[j] for j in group])
        middle = points.mean(axis=0)
        scatter = (points - middle).T @ (points - middle) / len(group)
        values, vectors = np.linalg.eigh(scatter)
        undecided |= values[1] - values[0] < 1e-6
        if not within(math.sqrt(max(values[0], 0.0)), thickness):
            continue
        normal = vectors[:, 0]
        toward = normal @ (np.asarray(at) - end)
        undecided |= abs(toward) < 1e-6
        normal = normal if toward >= 0 else -normal
        found.append([*(end - (normal @ (end - middle)) * normal), *normal])
        last = end
    return np.array(found).reshape(-1, 4).T, undecided


def nearest_to_cells(points, centres, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """For each centre (m, 2) the index of the nearest of the points (2, n), -1 for none within reach; and how much
    nearer it is than the next best."""
    if points.shape[1] == 0:
        return np.full(len(centres), -1), np.full(len(centres), math.inf)
    away = np.hypot(centres[:, :1] - points[0], centres[:, 1:] - points[1])
    ranked = np.sort(np.column_stack([away, np.full((len(away), 2), math.inf)]), axis=1)
    margin = np.minimum(ranked[:, 1] - ranked[:, 0], np.abs(ranked[:, 0] - reach))
    return np.where(ranked[:, 0] <= reach, away.argmin(axis=1), -1), margin


class Walls:
    """Remembered points (4, n) with their normals; a place asks for the point nearest to its cell's centre."""

    def __init__(self, points, size: float, reach: float) -> None:
        self.points, self.size, self.reach = points.astype(float), size, reach

    def beside(self, places) -> tuple[np.ndarray, np.ndarray, bool]:
        """For places (2, m): index of a wall's point, its distance (inf for none), and whether any is a near thing."""
        at = places / self.size
        centres = (np.floor(at) + 0.5) * self.size
        index, margin = nearest_to_cells(self.points[:2], centres.T, self.reach)
        away = np.hypot(*(places - self.points[:2, index]))
        close = bool((margin < 1e-6).any() or (np.abs(at - np.round(at)) < 1e-6).any())
        return index, np.where(index >= 0, away, math.inf), close


def posed(seen, pose) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (2, n each) of the robot's frame, where a pose sees them."""
    turn = np.array([[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]])
    return np.asarray(pose[:2])[:, None] + turn @ seen[:2].astype(float), turn @ seen[2:].astype(float)


def pairs(seen, pose, walls: Walls, limit: float, facing: float):
    """Which points have a wall within the limit that faces as they do: mask, indices of the walls, distances from
    their lines, and whether rounding decides any of it."""
    at, normals = posed(seen, pose)
    index, away, close = walls.beside(at)
    cosine = np.einsum("ij,ij->j", walls.points[2:, index], normals)
    close |= bool((np.abs(away - limit) < 1e-6).any() or (np.abs(cosine - facing) < 1e-6).any())
    error = np.einsum("ij,ij->j", walls.points[2:, index], at - walls.points[:2, index])
    return (away <= limit) & (cosine >= facing), index, error, close


def gauss_newton(seen, pose, walls: Walls, limit: float, width: float, facing: float):
    """One step of the point-to-line match with weights 1 / (1 + (e / width)^2)^2: its pose, and the normal equations
    (3, 3), with the derivative of every distance by x, y and yaw as a difference."""
    mask, index, error, close = pairs(seen, pose, walls, limit, facing)
    rows = []
    for k in np.flatnonzero(mask):
        normal, tiny = walls.points[2:, index[k]], 1e-6
        row = []
        for axis in range(3):
            ends = []
            for side in (-tiny, tiny):
                other = np.array(pose, float)
                other[axis] += side
                ends.append(normal @ (posed(seen[:, k : k + 1], other)[0][:, 0] - walls.points[:2, index[k]]))
            row.append((ends[1] - ends[0]) / (2 * tiny))
        rows.append(row)
    jacobian = np.array(rows).reshape(-1, 3)
    weights = 1 / (1 + (error[mask] / width) ** 2) ** 2
    normal = jacobian.T @ (weights[:, None] * jacobian)
    step = np.linalg.solve(normal + 1e-3 * np.eye(3), -jacobian.T @ (weights * error[mask]))
    return pose + step, normal, step, close


def align(seen, guess, walls: Walls, reach: float, scale: float, facing: float):
    """The whole match: from wide to narrow, until nothing moves. Pose, normal equations of the last step, undecided."""
    pose, limit, width, undecided = np.array(guess, float), reach, max(scale, reach / 2), False
    normal = np.zeros((3, 3))
    for turn in range(25):
        pose, normal, step, close = gauss_newton(seen, pose, walls, limit, width, facing)
        largest = np.abs(step).max()
        undecided |= close or abs(largest - 2e-4) < 1e-7 or abs(largest - 0.05) < 1e-6
        if width <= scale and largest < 2e-4:
            break
        if largest < 0.05 or turn > 8:
            limit, width = max(3 * scale, 0.6 * limit), max(scale, 0.5 * width)
    return pose, normal, undecided


def fit(seen, pose, walls: Walls, scale: float, facing: float) -> tuple[float, bool]:
    """Mean over all points of exp(-e^2 / 2 scale^2), zero for those that have no wall within 6 scale."""
    mask, _, error, close = pairs(seen, pose, walls, 6 * scale, facing)
    return float(np.sum(np.exp(-0.5 * (error[mask] / scale) ** 2)) / max(seen.shape[1], 1)), close


def sweep(seen, centre, half_width, step, angles, walls: Walls, near: float) -> np.ndarray:
    """Share of points that have a wall near, less 1 per mille for every metre and radian away: (angles, rows, cols)."""
    side = round(half_width / step)
    scores = np.empty((len(angles), 2 * side + 1, 2 * side + 1))
    for a, row, col in np.ndindex(scores.shape):
        dx, dy = (col - side) * step, (row - side) * step
        at, _ = posed(seen, (centre[0] + dx, centre[1] + dy, angles[a]))
        scores[a, row, col] = np.mean(walls.beside(at)[1] <= near)
        scores[a, row, col] -= 1e-3 * (abs(dx) + abs(dy) + abs(angles[a] - centre[2]))
    return scores


# --- a belief over the cells of a lattice ----------------------------------------------------------------------------


def spread(lists, moves, height: int, width: int) -> dict[tuple[int, int, int], float]:
    """What each cell (heading, row, column) gathers; ``lists``: for each list its cells (row, column) with a weight;
    ``moves``: (target heading, source list, rows down, columns right, share)."""
    gathered: dict[tuple[int, int, int], float] = {}
    for target, source, down, right, share in moves:
        for (row, col), weight in lists[source].items():
            at = (target, row + down, col + right)
            if 0 <= at[1] < height and 0 <= at[2] < width:
                gathered[at] = gathered.get(at, 0.0) + share * weight
    return gathered


def whole_number_gaussian(mean: float, variance: float, most: int, *, widths: float, narrow: float) -> dict[int, float]:
    """Weights of whole numbers: a Gaussian's density at them, or below ``narrow`` three with its first two moments."""
    nearest = round(mean)
    part = mean - nearest
    if variance < narrow:
        second = max(variance + part**2, abs(part))
        return {nearest - 1: (second - part) / 2, nearest: 1.0 - second, nearest + 1: (second + part) / 2}
    reach = min(most, max(1, math.ceil(widths * math.sqrt(variance))))
    density = {nearest + k: math.exp(-((k - part) ** 2) / (2 * variance)) for k in range(-reach, reach + 1)}
    total = sum(density.values())
    return {k: value / total for k, value in density.items()}


def _between_two(at: float) -> list[tuple[int, float]]:
    low = math.floor(round(at, 9))
    return [(low, 1.0 - (round(at, 9) - low)), (low + 1, round(at, 9) - low)]


def lattice_transition(before, after, step, covariance, shape, *, widths: float, narrow: float) -> np.ndarray:
    """p(cell after | cell before), (headings * height * width) squared, for a move with Gaussian noise.

    ``before``, ``after``: cell size, turn, shift (headings, 2) and first heading of the lattice at either time.
    """
    size, turn, shift, yaw = before
    _, _, later, later_yaw = after
    n, (height, width) = len(shift), shape
    mean = math.remainder(step[2] - (later_yaw - yaw), 2 * math.pi) / turn
    turns = whole_number_gaussian(mean, covariance[2, 2] / turn**2, (n - 1) // 2, widths=widths, narrow=narrow)
    given = covariance[:2, :2] - np.outer(covariance[:2, 2], covariance[:2, 2]) / covariance[2, 2]

    def landed(h: int, k: int) -> np.ndarray:
        ahead = step[:2] + covariance[:2, 2] / covariance[2, 2] * (k - mean) * turn
        c, s = math.cos(yaw + h * turn), math.sin(yaw + h * turn)
        return shift[h] + np.array([[c, -s], [s, c]]) @ ahead / size - later[(h + k) % n]

    transition = np.zeros((n, height, width, n, height, width))
    drifts = []
    for t in range(n):
        excess = np.zeros(2)
        for k, share in turns.items():
            for axis in (0, 1):
                (_, one), (_, other) = _between_two(landed((t - k) % n, k)[axis])
                excess[axis] += share * one * other
        c, s = math.cos(later_yaw + t * turn - step[2]), math.sin(later_yaw + t * turn - step[2])
        rotation = np.array([[c, -s], [s, c]])
        about = rotation @ given @ rotation.T / size**2
        variances = np.maximum(np.diag(about) - excess, 0.0)
        first = 0 if variances[0] >= variances[1] else 1
        both = math.sqrt(variances[0] * variances[1])
        slope = min(max(about[0, 1], -both), both) / max(variances[first], 1e-9)
        left = variances[1 - first] - slope**2 * variances[first]
        along = whole_number_gaussian(0.0, variances[first], max(shape), widths=widths, narrow=narrow)
        left -= sum(w * math.prod(part for _, part in _between_two(slope * k)) for k, w in along.items())
        across = whole_number_gaussian(0.0, max(left, 0.0), max(shape), widths=widths, narrow=narrow)
        ways = [(k, aside, w * part) for k, w in along.items() for aside, part in _between_two(slope * k)]
        drifts.append((first, ways, across))
    for h, row, col in itertools.product(range(n), range(height), range(width)):
        for k, share in turns.items():
            x, y = landed(h, k)
            for (right, a), (down, b) in itertools.product(_between_two(x), _between_two(y)):
                t, i, j = (h + k) % n, row + down, col + right
                first, ways, across = drifts[t]
                # What leaves the map on the way is gone.
                for k1, k2, w in ways if 0 <= i < height and 0 <= j < width else ():
                    i1, j1 = (i + k2, j + k1) if first == 0 else (i + k1, j + k2)
                    for k3, v in across.items() if 0 <= i1 < height and 0 <= j1 < width else ():
                        i2, j2 = (i1 + k3, j1) if first == 0 else (i1, j1 + k3)
                        if 0 <= i2 < height and 0 <= j2 < width:
                            transition[h, row, col, t, i2, j2] += share * a * b * w * v
    return transition.reshape(n * height * width, -1)
