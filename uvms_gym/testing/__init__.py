"""A checker for Gymnasium vector environments, native ones above all.

```python
>>> import gymnasium, uvms_gym
>>> from uvms_gym.testing import check_vector_env
>>> options = {"scene": "bluerov2-heavy", "max_episode_steps": 5}
>>> envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=3, **options)
>>> check_vector_env(envs, single=lambda: gymnasium.make("UVMS-StationKeep-v0", **options))

```
"""

from collections.abc import Callable, Collection
from typing import Any

import gymnasium
from gymnasium.vector import VectorEnv

from uvms_gym.testing import episodes, rules
from uvms_gym.testing.subject import Subject, Violation

__all__ = ["RULES", "Violation", "check_vector_env"]

#: What is checked, in this order.
RULES: dict[str, Callable[[Subject], None]] = {
    "metadata": rules.metadata,
    "spaces": rules.spaces,
    "order": rules.order,
    "results": rules.results,
    "infos": rules.infos,
    "seeding": rules.seeding,
    "fresh": rules.fresh,
    "autoreset": episodes.autoreset,
    "masks": episodes.masks,
    "options": episodes.options,
    "actions": rules.actions,
    "render": rules.render,
    "parity": episodes.parity,
    "close": rules.close,
}


def check_vector_env(
    env: VectorEnv[Any, Any, Any],
    *,
    single: str | Callable[[], gymnasium.Env[Any, Any]] | None = None,
    seed: int = 123,
    steps: int = 100,
    skip: Collection[str] = (),
) -> None:
    """Check that a vector environment keeps Gymnasium's contract, and close it.

    The rules, each checked on the results of random actions (`RULES` has their names in order):

    - `metadata`: `num_envs`; `metadata["autoreset_mode"]` is an `AutoresetMode`, on metadata of the instance's own;
      the render mode is one of those listed, with a frame rate.
    - `spaces`: batched spaces are those that `batch_space` makes of the single ones.
    - `order`: a step before the first reset is refused.
    - `results`: observations lie in their space, rewards are finite float64 (N,), flags bool (N,), infos a dict.
    - `infos`: every entry is an array of N with a mask `_key`, bool (N,), or a dict of such.
    - `seeding`: the same seed and actions give the same numbers; an int gives environment i the seed `seed + i`, a list
      gives each its own; a list of another length is refused; without a seed the streams go on.
    - `fresh`: results share no memory with those of other calls, do not change later, and are the caller's to write to.
    - `autoreset`: what the mode says of the end of an episode (see below).
    - `masks`: with `DISABLED`, `reset(options={"reset_mask": mask})` starts those in the mask alone, and refuses what
      is no bool array (N,) with a True in it.
    - `options`: the caller's dict is not changed.
    - `actions`: actions of a wrong shape, not finite, or out of a discrete range are refused with a `ValueError`, and
      nothing has changed then.
    - `render`: without a mode it warns and gives None or N times None; with `rgb_array` a sequence of N pictures.
    - `parity`: the numbers are those of a `SyncVectorEnv` of `single`, bit for bit.
    - `close`: it may be closed twice.

    Autoreset: with `NEXT_STEP` the step after an episode's end ignores the action, and gives the first observation of
    the next episode with reward 0. With `SAME_STEP` the ending step itself does, with `final_obs` and `final_info` and
    their masks. With `DISABLED` neither happens, and a step of what has ended is refused.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        Just made, not reset yet; wrapped or not. Episodes must end within `steps`.
    single : str, callable or None
        Id, or maker, of the single environment that instances are to be like, with the same time limit; None: `parity`
        is not checked.
    seed : int
        Of resets and actions.
    steps : int
        Length of the runs.
    skip : collection of str
        Rules that are not checked.

    Raises
    ------
    Violation
        An `AssertionError` that says which rule is broken, where, and what was expected.
    TypeError, ValueError
        The arguments make no sense.
    """
    if not isinstance(env, VectorEnv):
        raise TypeError(f"env must be a gymnasium.vector.VectorEnv, not {type(env).__name__}")
    if unknown := set(skip) - RULES.keys():
        raise ValueError(f"unknown rule {min(unknown)!r}; known: {', '.join(RULES)}")
    if steps < 2:
        raise ValueError(f"steps is {steps}, but must be at least 2")
    name = single
    make = (lambda: gymnasium.make(name)) if isinstance(name, str) else name
    subject = Subject(env, make, seed, steps)
    for rule, check in RULES.items():
        if rule in skip:
            continue
        try:
            check(subject)
        except Violation as violation:
            raise Violation(f"{rule}: {violation}") from None
        except Exception as error:
            error.add_note(f"This came up when check_vector_env checked the rule {rule!r}.")
            raise
