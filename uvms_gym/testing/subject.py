"""What is checked, and how it is run."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import cached_property
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

#: How an environment may refuse: anything else is taken for an accident.
REFUSALS = (gymnasium.error.Error, ValueError, TypeError, AssertionError, RuntimeError)

Call = tuple[str, tuple[Any, ...]]


class Violation(AssertionError):
    """A rule is broken; the message says which, where, and what was expected."""


def demand(holds: Any, message: str) -> None:
    """Raise a `Violation` unless `holds`."""
    if not holds:
        raise Violation(message)


class Subject:
    """A vector environment with the actions that it is run by."""

    def __init__(
        self,
        env: VectorEnv[Any, Any, Any],
        single: Callable[[], gymnasium.Env[Any, Any]] | None,
        seed: int,
        steps: int,
    ) -> None:
        self.env: Any = env
        self.single = single
        self.seed = seed
        self.n = env.num_envs
        self.steps = steps

    @property
    def mode(self) -> Any:
        """The autoreset mode."""
        return self.env.metadata.get("autoreset_mode")

    @cached_property
    def actions(self) -> list[Any]:
        """Random actions of one run, and one batch more."""
        self.env.action_space.seed(self.seed)
        return [self.env.action_space.sample() for _ in range(self.steps + 1)]

    def run(self, steps: int | None = None, env: Any = None) -> Iterator[Call]:
        """Reset with the seed and step; names and results of the calls.

        With autoreset disabled what has ended is reset by its mask.
        """
        env = self.env if env is None else env
        yield "reset", env.reset(seed=self.seed)
        for step, actions in enumerate(self.actions[: self.steps if steps is None else steps]):
            result = env.step(deepcopy(actions))
            over = ended(result) if self.mode is AutoresetMode.DISABLED else None
            yield f"step {step}", result
            if over is not None and over.any():
                yield f"reset after step {step}", env.reset(options={"reset_mask": over})

    def advance(self, steps: int) -> Any:
        """Run so far; the last observations."""
        observations = None
        for _, result in self.run(steps):
            observations = result[0]
        return observations

    @cached_property
    def record(self) -> list[Call]:
        """A copy of what a whole run gave."""
        return [(name, deepcopy(result)) for name, result in self.run()]

    @cached_property
    def taken(self) -> list[tuple[int, tuple[Any, ...]]]:
        """The steps of the record."""
        return list(enumerate(result for name, result in self.record if name.startswith("step")))

    @cached_property
    def ends(self) -> list[tuple[int, NDArray[np.bool_]]]:
        """Steps but the last at which episodes ended, and masks of those."""
        found = [(step, ended(result)) for step, result in self.taken[:-1]]
        found = [(step, over) for step, over in found if over.any()]
        demand(found, f"no episode ended within {self.steps} steps, so make them shorter or `steps` greater")
        return found

    def rows(self, observations: Any) -> list[Any]:
        """Observations of each instance."""
        return list(iterate(self.env.observation_space, observations))

    def mixed(self, actions: Any, others: Any, mask: NDArray[np.bool_]) -> Any:
        """`actions`, but `others` in the mask."""
        space = self.env.single_action_space
        pairs = zip(iterate(self.env.action_space, actions), iterate(self.env.action_space, others), strict=True)
        chosen = [b if where else a for (a, b), where in zip(pairs, mask, strict=True)]
        return concatenate(space, chosen, cast(Any, create_empty_array(space, self.n)))


def ended(result: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Instances whose episode ends with a step."""
    over: NDArray[np.bool_] = np.logical_or(result[2], result[3])
    return over
