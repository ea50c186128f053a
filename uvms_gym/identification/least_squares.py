"""Robust least squares with priors, bounds, and parameters of single trials: Levenberg-Marquardt."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from uvms_gym.identification.recordings import Floats

#: Residual, in deviations of the noise, from which on its weight falls.
ROBUST = 2.0
#: Decrease of the cost at which the iteration ends; the cost is the logarithm of a likelihood.
TOLERANCE = 0.01
#: Most iterations.
ITERATIONS = 30


class Problem(Protocol):
    """Residuals of trials: N trials, p common parameters, m parameters of every trial."""

    #: (p,), (m,) standard deviations of the priors of common parameters, and of a trial's parameters.
    deviations: Floats
    own_deviations: Floats
    #: (p,), (N, m) start, the mean of the priors.
    origin: Floats
    own_origin: Floats
    #: Minimum and maximum common parameters, each (p,).
    bounds: tuple[Floats, Floats]
    #: (p,) steps of finite differences of the common parameters.
    differences: Floats
    #: Weight of a residual: the share of independent ones.
    share: float

    def residuals(self, common: Floats, own: Floats) -> Floats:
        """(N, R) residuals in deviations of the noise at common (p,) and own (N, m) parameters; 0 where unknown."""
        ...


@dataclass(frozen=True, eq=False)
class Solution:
    """Minimum of a problem, and its derivatives with the parameters of single trials eliminated."""

    #: (p,), (N, m) parameters.
    common: Floats
    own: Floats
    #: Cost, priors included.
    cost: float
    #: Number of steps.
    iterations: int
    #: False after an interruption, or too many iterations.
    converged: bool
    #: True after an interruption.
    interrupted: bool
    #: (N, p, p) information of each trial about the common parameters.
    information: Floats
    #: (N, p) gradient of each trial's cost.
    scores: Floats
    #: (p,) True where a bound limits a parameter.
    at_bound: Floats


@dataclass(frozen=True, eq=False)
class _Point:
    common: Floats
    own: Floats
    residuals: Floats
    cost: float


def minimise(problem: Problem, report: Callable[[int, float], None] | None = None, stoppable: bool = False) -> Solution:
    """Minimise the robust cost from the problem's start.

    `report` is called after every iteration with its number and the cost. With `stoppable`, KeyboardInterrupt ends the
    iteration at the best parameters so far, and the solution says so.
    """
    low, high = problem.bounds
    point = _evaluate(problem, problem.origin, problem.own_origin)
    damping, iterations, converged, interrupted = 1e-3, 0, False, False
    model = _linearise(problem, point)
    try:
        while iterations < ITERATIONS and not converged:
            step, own_step = _step(problem, point, model, damping)
            candidate = _evaluate(problem, np.clip(point.common + step, low, high), point.own + own_step)
            iterations += 1
            gain = point.cost - candidate.cost
            if gain > 0.0:
                damping = max(damping / 5.0, 1e-4)
                converged = gain < TOLERANCE
                # (Both at once: an interruption must not part them.)
                point, model = candidate, _linearise(problem, candidate)
            else:
                converged = damping > 1e6 or abs(gain) < TOLERANCE
                damping *= 10.0
            if report is not None:
                report(iterations, point.cost)
    except KeyboardInterrupt:
        if not stoppable:
            raise
        converged, interrupted = False, True
    information, scores = model.eliminated()
    held = _held(problem, point.common, scores.sum(axis=0) + (point.common - problem.origin) / problem.deviations**2)
    return Solution(
        common=point.common,
        own=point.own,
        cost=point.cost,
        iterations=iterations,
        converged=converged,
        interrupted=interrupted,
        information=information,
        scores=scores,
        at_bound=held,
    )


@dataclass(frozen=True, eq=False)
class _Model:
    """Normal equations of every trial: A (N, p, p), B (N, p, m), C (N, m, m), gradients a (N, p) and c (N, m)."""

    A: Floats
    B: Floats
    C: Floats
    a: Floats
    c: Floats

    def eliminated(self) -> tuple[Floats, Floats]:
        """Information (N, p, p) and gradients (N, p) with the trials' own parameters eliminated."""
        if self.c.shape[1] == 0:
            return self.A, self.a
        solved = np.linalg.solve(self.C, np.concatenate([np.swapaxes(self.B, 1, 2), self.c[..., None]], axis=2))
        return self.A - self.B @ solved[..., :-1], self.a - (self.B @ solved[..., -1:])[..., 0]


def _evaluate(problem: Problem, common: Floats, own: Floats) -> _Point:
    r = problem.residuals(common, own)
    scaled = (r / ROBUST) ** 2
    data = problem.share * ROBUST**2 * float(np.sum(np.sqrt(1.0 + scaled) - 1.0))
    prior = 0.5 * float(np.sum(((common - problem.origin) / problem.deviations) ** 2))
    prior += 0.5 * float(np.sum((own / problem.own_deviations) ** 2))
    return _Point(common, own, r, data + prior)


def _linearise(problem: Problem, point: _Point) -> _Model:
    p, m = len(point.common), point.own.shape[1]
    high = problem.bounds[1]
    J = np.empty((*point.residuals.shape, p + m))
    for k in range(p):
        h = problem.differences[k]
        h = -h if point.common[k] + h > high[k] else h
        displaced = point.common.copy()
        displaced[k] += h
        J[..., k] = (problem.residuals(displaced, point.own) - point.residuals) / h
    for k in range(m):
        h = 0.1 * problem.own_deviations[k]
        own = point.own.copy()
        own[:, k] += h
        J[..., p + k] = (problem.residuals(point.common, own) - point.residuals) / h
    # Iteratively reweighted: the derivative of the cost is w r.
    w = problem.share / np.sqrt(1.0 + (point.residuals / ROBUST) ** 2)
    weighted = J * w[..., None]
    H = np.swapaxes(J, 1, 2) @ weighted
    g = np.einsum("nrk,nr->nk", weighted, point.residuals)
    own_prior = problem.own_deviations**-2.0
    C = H[:, p:, p:] + np.diag(own_prior)
    return _Model(H[:, :p, :p], H[:, :p, p:], C, g[:, :p], g[:, p:] + own_prior * point.own)


def _held(problem: Problem, common: Floats, gradient: Floats) -> Floats:
    low, high = problem.bounds
    width = 1e-9 * (high - low)
    return np.asarray(((common <= low + width) & (gradient > 0.0)) | ((common >= high - width) & (gradient < 0.0)))


def _step(problem: Problem, point: _Point, model: _Model, damping: float) -> tuple[Floats, Floats]:
    """Damped step of common and own parameters; those at a bound that stops them stay."""
    information, gradients = model.eliminated()
    precision = problem.deviations**-2.0
    S = information.sum(axis=0) + np.diag(precision)
    g = gradients.sum(axis=0) + precision * (point.common - problem.origin)
    held = _held(problem, point.common, g)
    S = S + damping * np.diag(np.diag(S))
    free = np.flatnonzero(np.logical_not(held))
    step = np.zeros(len(g))
    step[free] = -np.linalg.solve(S[np.ix_(free, free)], g[free])
    own = np.zeros_like(point.own)
    if model.c.shape[1]:
        right = model.c + np.einsum("npm,p->nm", model.B, step)
        own = -np.linalg.solve(model.C, right[..., None])[..., 0]
    return step, own
