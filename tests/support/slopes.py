"""Whether a figure grows: slopes by least squares, and what of them is noise."""
from dataclasses import dataclass

HOUR = 3600.0
SIGMAS = 3.0  # a slope beyond so many standard errors is no noise
MOST_ALIKE = 0.95  # of neighbouring residuals
ONCE, ONCE_MOST = 2, 160.0  # so many times a process may take so many KiB more for good: an arena of the allocator has 132 at first
LEAST = 16.0  # KiB: beside that, some pages in a life are no leak
STEEPEST = 1.5  # a line through one rise in the middle of a life is so much steeper than one from end to end


@dataclass
class Slope:
    """Both for each hour. `seconds`: how much time is behind it."""
    slope: float
    noise: float
    seconds: float

    def grows(self):
        return self.slope > self.noise


def without_once(life):
    """A process takes memory when something happens to it for the first time: a thread gets an arena, a batch is longer than ever. One such rise looks
    like a slope to least squares. So the largest two are taken away, as far as they are beyond the usual and no larger than an arena. What leaks goes on
    rising."""
    if len(life) < 2:
        return life
    moves = [after[1] - before[1] for before, after in zip(life, life[1:])]
    by_size = sorted(range(len(moves)), key=lambda i: moves[i], reverse=True)
    usual = sorted(map(abs, moves), reverse=True)[min(max(ONCE, len(moves) // 10), len(moves) - 1)]
    once, taken, left = {i: min(max(moves[i] - usual, 0.0), ONCE_MOST) for i in by_size[:ONCE]}, 0.0, life[:1]
    for i, (t, v) in enumerate(life[1:]):
        taken += once.get(i, 0.0)
        left.append((t, v - taken))
    return left


def centred(lives):
    """Each life's points around its own mean: what a process took at its start says nothing."""
    for life in lives:
        t_mean, v_mean = (sum(point[i] for point in life) / len(life) for i in (0, 1))
        yield [(t - t_mean, v - v_mean) for t, v in life]


def alike(residuals):
    """How much neighbours are: those of a figure that moves slowly are fewer than they seem."""
    squares = sum(e * e for life in residuals for e in life)
    products = sum(a * b for life in residuals for a, b in zip(life, life[1:]))
    return min(max(products / squares, 0.0), MOST_ALIKE) if squares > 0 else 0.0


def slope_of(lives):
    """`lives`: for each process that had the role, [(seconds, KiB)]. One slope for all of them; None if there are too few points."""
    lives = [life for life in lives if len(life) > 1]
    points = list(centred(lives))
    square = sum(t * t for life in points for t, _ in life)
    freedom = sum(map(len, points)) - len(points) - 1
    if square == 0 or freedom < 3:
        return None
    slope = sum(t * v for life in points for t, v in life) / square
    residuals = [[v - slope * t for t, v in life] for life in points]
    r = alike(residuals)
    variance = sum(e * e for life in residuals for e in life) / freedom / square
    error = (variance * (1 + r) / (1 - r)) ** 0.5
    seconds = sum(life[-1][0] - life[0][0] for life in lives)
    least = STEEPEST * LEAST * len(lives) / seconds
    return Slope(slope * HOUR, max(SIGMAS * error, least) * HOUR, seconds)


def count_grows(counts):
    """Of whole numbers that stay the same if nothing is left over: more at any time of the last third than ever in the first."""
    third = len(counts) // 3
    return third > 0 and min(counts[-third:]) > max(counts[:third])
