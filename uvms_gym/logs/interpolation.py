"""Interpolation of samples in time."""

import numpy as np

from uvms_gym.logs.units import Floats


def linear(time: Floats, values: Floats, times: Floats) -> Floats:
    """Linear interpolation of values (n, k) at sorted stamps (n,) at other times (m,): (m, k)."""
    return np.stack([np.interp(times, time, column) for column in values.T], axis=-1)


def pchip_slopes(time: Floats, values: Floats) -> Floats:
    """Slopes (n, k) of the monotone piecewise cubic through values (n, k): Fritsch-Butland means."""
    h = np.diff(time)[:, None]
    d = np.diff(values, axis=0) / h
    if len(time) == 2:
        return np.repeat(d, 2, axis=0)
    w1, w2 = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    turning = d[1:] * d[:-1] <= 0.0
    before, after = np.where(turning, 1.0, d[:-1]), np.where(turning, 1.0, d[1:])
    inner = np.where(turning, 0.0, (w1 + w2) / (w1 / before + w2 / after))
    first = _end_slope(h[0], h[1], d[0], d[1])
    last = _end_slope(h[-1], h[-2], d[-1], d[-2])
    return np.concatenate([first[None], inner, last[None]])


def _end_slope(h0: Floats, h1: Floats, d0: Floats, d1: Floats) -> Floats:
    """Slopes (k,) at an end, by three points, limited to preserve the shape."""
    slope = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    slope = np.where(slope * d0 <= 0.0, 0.0, slope)
    steep = (d0 * d1 <= 0.0) & (np.abs(slope) > 3.0 * np.abs(d0))
    return np.asarray(np.where(steep, 3.0 * d0, slope))


def pchip(time: Floats, values: Floats, times: Floats) -> tuple[Floats, Floats]:
    """Monotone piecewise cubic through values (n, k) at sorted stamps (n,): values and slopes at times, each (m, k)."""
    slopes = pchip_slopes(time, values)
    k = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(time) - 2)
    h = (time[k + 1] - time[k])[:, None]
    t = (times - time[k])[:, None]
    c = np.moveaxis(hermite((values[k], slopes[k]), (values[k + 1], slopes[k + 1]), h), -1, 0)
    return c[0] + t * (c[1] + t * (c[2] + t * c[3])), c[1] + t * (2.0 * c[2] + t * 3.0 * c[3])


def hermite(start: tuple[Floats, Floats], end: tuple[Floats, Floats], h: Floats | float) -> Floats:
    """Coefficients (..., 4) of the cubics over [0, h] with given values and slopes (...) at both ends."""
    (a, slope_a), (b, slope_b) = start, end
    d = (b - a) / h
    return np.stack(
        [a, slope_a, (3.0 * d - 2.0 * slope_a - slope_b) / h, (slope_a + slope_b - 2.0 * d) / h**2], axis=-1
    )


def local_quadratic(time: Floats, values: Floats, times: Floats, width: float) -> tuple[Floats, Floats]:
    """Local quadratic regression with Gaussian weights: values and slopes at times (m,), each (m, k).

    `time` (n,), at least four sorted stamps, and `values` (n, k) are the samples; `width` is the standard deviation of
    the weights, s, or the mean of the four intervals around where samples are sparse.
    """
    last = len(time) - 1
    i = np.arange(last + 1)
    around = (time[np.minimum(i + 2, last)] - time[np.maximum(i - 2, 0)]) / 4.0
    w = np.maximum(width, np.interp(times, time, around))
    first, end = np.searchsorted(time, times - 5.0 * w), np.searchsorted(time, times + 5.0 * w)
    index = first[:, None] + np.arange(np.max(end - first))  # (m, most samples in a window)
    inside = index < end[:, None]
    index = np.minimum(index, last)
    x = (time[index] - times[:, None]) / w[:, None]
    weights = np.where(inside, np.exp(-0.5 * x * x), 0.0)
    basis = np.stack([np.ones_like(x), x, x * x], axis=-1)  # (m, samples, 3)
    weighted = basis * weights[:, :, None]
    normal = np.einsum("msi,msj->mij", weighted, basis)
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3)  # three equal stamps, almost
    fit = np.linalg.solve(normal, np.einsum("msi,msk->mik", weighted, values[index]))
    return fit[:, 0], fit[:, 1] / w[:, None]
