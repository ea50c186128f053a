"""Uncertainty of a fit: covariance clustered by trial, correlations, and directions that the data do not determine."""

from dataclasses import dataclass

import numpy as np

from uvms_gym._extras import extra
from uvms_gym.identification.least_squares import Solution
from uvms_gym.identification.recordings import Floats

#: Share of the prior's variance from which on a direction counts as not determined by the data.
UNDETERMINED = 0.5
#: Probability of intervals.
PROBABILITY = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of p coordinates."""

    #: (p, p) covariance, clustered by trial.
    covariance: Floats
    #: (p,) standard deviations if every residual were independent.
    naive: Floats
    #: (p,) standard deviations of the priors.
    prior: Floats
    #: Half-width of the 95 % interval in standard deviations.
    quantile: float

    @property
    def deviations(self) -> Floats:
        """(p,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Floats:
        """(p, p) correlations."""
        d = self.deviations
        return np.asarray(self.covariance / np.outer(d, d))

    @property
    def shares(self) -> Floats:
        """(p,) variances as a share of the prior's: near 1 where the data say nothing."""
        return np.asarray(np.minimum((self.deviations / self.prior) ** 2, 1.0))

    @property
    def undetermined(self) -> list[tuple[float, Floats]]:
        """Directions that the data leave open: share of the prior's variance, and entries (p,) in its deviations."""
        values, vectors = np.linalg.eigh(self.covariance / np.outer(self.prior, self.prior))
        found = [(float(min(v, 1.0)), vectors[:, k]) for k, v in enumerate(values) if v > UNDETERMINED]
        return [(v, d * np.sign(d[np.argmax(np.abs(d))])) for v, d in reversed(found)]


def uncertainty(solution: Solution, prior: Floats, share: float) -> Uncertainty:
    """Uncertainty of a solution.

    Residuals of one trial are correlated, so that trials, not residuals, count as independent: the estimate is
    the jackknife over trials by one Newton step each (CR3), which is not too small for few trials either; priors count
    as one more observation each. Parameters at a bound stay there.

    The solution has N >= 2 trials; `prior` (p,) are standard deviations of the priors, and `share` is the weight of a
    residual in the fit.
    """
    with extra("cli"):
        from scipy.stats import t as student

    precision = np.diag(prior**-2.0)
    H = solution.information.sum(axis=0) + precision
    trials = len(solution.scores)
    free = np.flatnonzero(np.logical_not(solution.at_bound))
    block = np.ix_(free, free)
    scores = solution.scores[:, free] - solution.scores[:, free].mean(axis=0)
    without = H[block] - solution.information[:, free][:, :, free]
    moves = np.linalg.solve(without, scores[..., None])[..., 0]
    inverse = np.linalg.inv(H[block])
    free_covariance = (trials - 1) / trials * moves.T @ moves + inverse @ precision[block] @ inverse
    covariance = np.diag(prior**2 * 1e-12)
    covariance[block] = free_covariance
    naive = np.sqrt(np.diag(np.linalg.inv(solution.information.sum(axis=0) / share + precision)))
    return Uncertainty(covariance, naive, prior, float(student.ppf(0.5 + PROBABILITY / 2.0, trials - 1)))
