"""Rules about form, memory, seeds, actions and pictures."""

import warnings
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np
from gymnasium import error
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from uvms_gym.testing.compare import PARTS, arrays, difference, unlike
from uvms_gym.testing.subject import REFUSALS, Subject, Violation, demand

#: Gymnasium before 1.3 asserts what it refuses with other errors since.
ASSERTED = (AssertionError,)
#: How many calls back results are compared for shared memory.
_BACK = 4


def metadata(subject: Subject) -> None:
    """Number, autoreset mode and render mode."""
    env = subject.env
    demand(
        isinstance(env.num_envs, int | np.integer) and env.num_envs >= 1,
        f"num_envs is {env.num_envs!r}, but must be an int of at least 1",
    )
    demand(
        isinstance(subject.mode, AutoresetMode),
        f"metadata['autoreset_mode'] is {subject.mode!r}, but must be an instance of gymnasium.vector.AutoresetMode",
    )
    base = env.unwrapped
    demand(
        base.metadata is not type(base).metadata,
        f"metadata is the dict of the class {type(base).__name__}, but every instance must have its own",
    )
    if env.render_mode is not None:
        listed, rate = env.metadata.get("render_modes", []), env.metadata.get("render_fps")
        demand(
            env.render_mode in listed, f"render_mode is {env.render_mode!r}, but metadata['render_modes'] is {listed}"
        )
        demand(rate and rate > 0, f"metadata['render_fps'] is {rate!r}, but must be a positive number")


def spaces(subject: Subject) -> None:
    """Batched spaces."""
    for kind in ("observation", "action"):
        one, batch = getattr(subject.env, f"single_{kind}_space"), getattr(subject.env, f"{kind}_space")
        expected = batch_space(one, subject.n)
        demand(batch == expected, f"{kind}_space is {batch}, but batching single_{kind}_space gives {expected}")


def order(subject: Subject) -> None:
    """A step before the first reset."""
    try:
        subject.env.step(subject.actions[0])
    except REFUSALS as refusal:
        demand(str(refusal), f"a step before the first reset raised {type(refusal).__name__} without a message")
        return
    except Exception as accident:
        raise Violation(
            f"a step before the first reset raised {accident!r}, but must raise gymnasium.error.ResetNeeded"
        ) from accident
    raise Violation(
        "a step before the first reset was taken, but must raise gymnasium.error.ResetNeeded "
        "(the environment to check must be fresh)"
    )


def results(subject: Subject) -> None:
    """Kinds, types and shapes."""
    for name, result in subject.record:
        size = 5 if name.startswith("step") else 2
        demand(
            isinstance(result, tuple) and len(result) == size,
            f"{name} gave {type(result).__name__}, but must give a tuple of {size}: {', '.join(PARTS[size])}",
        )
        _check_observations(subject.env.observation_space, result[0], name)
        demand(isinstance(result[-1], dict), f"{name}: infos is {type(result[-1]).__name__}, but must be a dict")
        if size == 5:
            for what, given, dtype in zip(PARTS[5][1:4], result[1:4], (np.float64, np.bool_, np.bool_), strict=True):
                _check_array(given, dtype, (subject.n,), f"{name}: {what}")
            demand(np.isfinite(result[1]).all(), f"{name}: rewards are {result[1]}, but must be finite")


def _check_observations(space: gymnasium.spaces.Space[Any], observations: Any, name: str) -> None:
    if isinstance(space, gymnasium.spaces.Box):
        _check_array(observations, space.dtype, space.shape, f"{name}: observations")
        outside = np.argwhere(~((observations >= space.low) & (observations <= space.high)))
        if len(outside):
            place = tuple(outside[0].tolist())
            raise Violation(
                f"{name}: observations{list(place)} is {observations[place]!r}, but must lie in "
                f"[{space.low[place]}, {space.high[place]}]"
            )
    demand(space.contains(observations), f"{name}: observations do not lie in {space}")


def _check_array(given: Any, dtype: Any, shape: tuple[int, ...], what: str) -> None:
    wanted = f"an array of {np.dtype(dtype)} with shape {shape}"
    demand(isinstance(given, np.ndarray), f"{what} are {type(given).__name__}, but must be {wanted}")
    demand(
        given.dtype == dtype and given.shape == shape,
        f"{what} are an array of {given.dtype} with shape {given.shape}, but must be {wanted}",
    )


def infos(subject: Subject) -> None:
    """Arrays with masks."""
    for name, result in subject.record:
        _check_infos(result[-1], subject.n, f"{name}: infos")


def _check_infos(given: Mapping[str, Any], n: int, where: str) -> None:
    for key, value in given.items():
        if key.startswith("_") and key[1:] in given:
            _check_array(value, np.bool_, (n,), f"{where}[{key!r}]")
            continue
        demand(f"_{key}" in given, f"{where} has {key!r} without its mask '_{key}'")
        if isinstance(value, Mapping):
            _check_infos(value, n, f"{where}[{key!r}]")
            continue
        kind = f"{type(value).__name__} of shape {np.shape(value)}"
        demand(
            isinstance(value, np.ndarray) and value.shape[:1] == (n,),
            f"{where}[{key!r}] is {kind}, but must be an array of {n} entries",
        )


def seeding(subject: Subject) -> None:
    """The same seeds give the same numbers."""
    env, seed, n = subject.env, subject.seed, subject.n
    for (name, got), (_, expected) in zip(subject.run(), subject.record, strict=True):
        agree(got, expected, f"{name} of a second run with seed {seed} and the same actions")
    first = deepcopy(env.reset(seed=seed))
    agree(env.reset(seed=[seed + i for i in range(n)]), first, f"reset with a list of seeds {seed} + i, not {seed},")
    starts = subject.rows(first[0])
    for i in range(1, min(n, 4)):
        row = deepcopy(subject.rows(env.reset(seed=seed + i)[0])[0])
        if found := unlike(starts[i], row, f"observations[{i}]"):
            raise Violation(f"with seed {seed} instance {i} must start as with the seed {seed + i}, but {found}")
    nexts = []
    for _ in range(2):
        env.reset(seed=seed)
        nexts.append(deepcopy(env.reset()))
    agree(nexts[1], nexts[0], f"a reset without a seed after one with seed {seed}, done again,")
    refuses(lambda: env.reset(seed=[seed] * (n + 1)), f"a list of {n + 1} seeds", (ValueError, *ASSERTED))


def fresh(subject: Subject) -> None:
    """No memory is shared between calls."""
    kept: deque[tuple[str, Any, dict[str, Any], dict[str, Any]]] = deque(maxlen=_BACK)
    for name, result in subject.run(_past_an_end(subject)):
        now = dict(arrays(result))
        for earlier, dictionary, then, copies in kept:
            demand(result[-1] is not dictionary, f"{name} gives the infos dict of {earlier}, but must give a new one")
            for path, array in now.items():
                for old_path, old in then.items():
                    demand(
                        not np.shares_memory(array, old), f"{path} of {name} shares memory with {old_path} of {earlier}"
                    )
            for path, old in then.items():
                if found := unlike(old, copies[path], path):
                    raise Violation(f"{name} changed what {earlier} gave: {found}")
        for path, array in now.items():
            demand(array.flags.writeable, f"{path} of {name} is read-only, but must be the caller's own")
        kept.append((name, result[-1], now, deepcopy(now)))
    for (name, result), (_, expected) in zip(subject.run(), subject.record, strict=True):
        agree(result, expected, f"{name}, after the arrays of earlier results were written to,")
        for _, array in list(arrays(result)):
            array[...] = None if array.dtype == object else 77
        if isinstance(result[-1], dict):
            result[-1].clear()


def _past_an_end(subject: Subject) -> int:
    return min(subject.steps, subject.ends[0][0] + _BACK)


def actions(subject: Subject) -> None:
    """Bad actions are refused without harm."""
    at = max(subject.ends[0][0] - 1, 0)
    subject.advance(at)
    expected = deepcopy(subject.env.step(deepcopy(subject.actions[at])))
    for what, bad in _bad_actions(subject.env.action_space, subject.actions[at]):
        subject.advance(at)
        refuses(lambda bad=bad: subject.env.step(bad), what, (ValueError, error.InvalidAction))
        agree(subject.env.step(deepcopy(subject.actions[at])), expected, f"step {at} after {what} had been refused")


def _bad_actions(space: gymnasium.spaces.Space[Any], good: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(good, np.ndarray):
        return
    yield f"actions of shape {good[:-1].shape} instead of {good.shape}", good[:-1]
    yield f"actions of shape {good[None].shape} instead of {good.shape}", good[None]
    for value in (np.nan, np.inf) if good.dtype.kind == "f" else ():
        bad = good.copy()
        bad[-1] = value
        yield f"actions with {value} in the last row", bad
    if isinstance(space, gymnasium.spaces.MultiDiscrete):
        bad = good.copy()
        bad[-1] = (space.start + space.nvec)[-1]
        yield f"actions with {bad[-1]}, out of range, in the last row", bad


def render(subject: Subject) -> None:
    """Pictures."""
    env, n = subject.env, subject.n
    env.reset(seed=subject.seed)
    if env.render_mode is None:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            given = env.render()
        nothing = given is None or (len(given) == n and all(picture is None for picture in given))
        demand(nothing, f"without a render mode render() gave {given!r}, but must give None or {n} times None")
        demand(caught, "without a render mode render() must warn, but did not")
    elif env.render_mode == "rgb_array":
        given = env.render()
        kind = f"{type(given).__name__} of length {len(given)}"
        demand(
            isinstance(given, Sequence) and len(given) == n,
            f"render() gave {kind}, but must give a sequence (such as a tuple) of {n}",
        )
        for i, picture in enumerate(given):
            form = (getattr(picture, "dtype", None), np.shape(picture))
            demand(
                form[0] == np.uint8 and len(form[1]) == 3 and form[1][2] == 3,
                f"render()[{i}] is {type(picture).__name__} of dtype {form[0]} with shape {form[1]}, "
                "but must be an array of uint8 with shape (height, width, 3)",
            )


def close(subject: Subject) -> None:
    """Closing, twice."""
    subject.env.close()
    subject.env.close()
    demand(subject.env.closed, "closed is not True after close()")


def agree(got: Any, expected: Any, what: str) -> None:
    """Two results of a call are the same, bit for bit."""
    if found := difference(got, expected):
        raise Violation(f"{what} gave other numbers: {found}")


def refuses(call: Any, what: str, kinds: tuple[type[Exception], ...]) -> None:
    """A call is refused, by errors of certain kinds."""
    named = " or ".join(kind.__name__ for kind in kinds)
    try:
        call()
    except kinds as refusal:
        demand(str(refusal), f"{what} raised {type(refusal).__name__} without a message")
        return
    except Exception as other:
        raise Violation(f"{what} raised {other!r}, but must raise {named}") from other
    raise Violation(f"{what} went through, but must raise {named}")
