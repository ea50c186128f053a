"""Rules about the ends of episodes."""

from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from uvms_gym.testing.compare import difference, unlike
from uvms_gym.testing.rules import ASSERTED, agree, refuses
from uvms_gym.testing.subject import REFUSALS, Subject, Violation, demand

_FINALS = ("final_obs", "final_info")


def autoreset(subject: Subject) -> None:
    """What the mode says."""
    {
        AutoresetMode.NEXT_STEP: _next_step,
        AutoresetMode.SAME_STEP: _same_step,
        AutoresetMode.DISABLED: _disabled,
    }[subject.mode](subject)


def _next_step(subject: Subject) -> None:
    _gives_no_finals(subject)
    alike = []
    for step, over in subject.ends:
        last, (observations, rewards, terminated, truncated, _) = (subject.taken[k][1] for k in (step, step + 1))
        for i in np.flatnonzero(over):
            where = f"step {step + 1}, with which instance {i} starts an episode,"
            demand(rewards[i] == 0.0, f"{where} gave it the reward {rewards[i]}, but must give 0")
            demand(
                not terminated[i] and not truncated[i],
                f"{where} says terminated {terminated[i]}, truncated {truncated[i]}, but both must be False",
            )
            alike.append(unlike(subject.rows(observations)[i], subject.rows(last[0])[i], "") is None)
    demand(
        not all(alike),
        f"step {subject.ends[0][0]}, with which an episode ends, gave the first observation of the next one, but must "
        "give the last one of its own",
    )
    step, over = subject.ends[0]
    subject.advance(step + 1)
    agree(
        subject.env.step(subject.mixed(subject.actions[step + 1], _others(subject, step + 1), over)),
        subject.taken[step + 1][1],
        f"step {step + 1} with another action for instance {np.flatnonzero(over)[0]}, which starts an episode and must "
        "ignore its action,",
    )


def _others(subject: Subject, step: int) -> Any:
    """Other actions than those of a step, in every row."""
    space, actions = subject.env.action_space, subject.actions[step]
    others, same = actions, np.ones(subject.n, dtype=np.bool_)
    for _ in range(50):
        others = subject.mixed(others, space.sample(), same)
        pairs = zip(iterate(space, actions), iterate(space, others), strict=True)
        same = np.array([unlike(a, b, "") is None for a, b in pairs])
        if not same.any():
            break
    return others


def _same_step(subject: Subject) -> None:
    alike = []
    for step, (observations, _, terminated, truncated, infos) in subject.taken:
        over = terminated | truncated
        for key in _FINALS:
            mask = infos.get(f"_{key}", np.zeros(subject.n, dtype=np.bool_))
            demand(
                (mask == over).all(),
                f"step {step}: infos['_{key}'] is {mask}, but must be {over}, where episodes ended",
            )
        if not over.any():
            continue
        finals = infos["final_obs"]
        demand(
            finals.dtype == object and isinstance(infos["final_info"], dict),
            f"step {step}: infos['final_obs'] is an array of {finals.dtype}, infos['final_info'] is "
            f"{type(infos['final_info']).__name__}, but they must be an array of objects and a dict",
        )
        for i, final in enumerate(finals):
            where = f"step {step}: infos['final_obs'][{i}]"
            if not over[i]:
                demand(final is None, f"{where} is {final!r}, but must be None where no episode ended")
                continue
            demand(
                final is not None and subject.env.single_observation_space.contains(final),
                f"{where} is {final!r}, but must lie in single_observation_space",
            )
            alike.append(unlike(subject.rows(observations)[i], final, "") is None)
    demand(
        not all(alike),
        f"step {subject.ends[0][0]}, with which an episode ends, gave its last observation, but must give the "
        "first one of the next",
    )


def _disabled(subject: Subject) -> None:
    _gives_no_finals(subject)
    step, over = subject.ends[0]
    subject.advance(step)
    subject.env.step(deepcopy(subject.actions[step]))
    refuses(
        lambda: subject.env.step(deepcopy(subject.actions[step + 1])),
        f"step {step + 1}, though instance {np.flatnonzero(over)[0]} has ended its episode and autoreset is disabled,",
        REFUSALS,
    )


def _gives_no_finals(subject: Subject) -> None:
    for step, result in subject.taken:
        for key in _FINALS:
            demand(
                not np.any(result[-1].get(f"_{key}", False)) and key not in result[-1],
                f"step {step}: infos has {key!r}, but only AutoresetMode.SAME_STEP gives it",
            )


def masks(subject: Subject) -> None:
    """Resets of some."""
    if subject.mode is not AutoresetMode.DISABLED:
        return
    env, n, at = subject.env, subject.n, 1
    mask = np.zeros(n, dtype=np.bool_)
    mask[0] = True
    before = deepcopy(subject.advance(at))
    undisturbed = deepcopy(env.step(deepcopy(subject.actions[at])))
    subject.advance(at)
    after, infos = deepcopy(env.reset(seed=subject.seed + 1, options={"reset_mask": mask.copy()}))
    for key, value in infos.items():
        if key.startswith("_") and key[1:] in infos:
            demand((value == mask).all(), f"a reset of {mask} gave infos[{key!r}] = {value}, but it must be {mask}")
    stepped = deepcopy(env.step(deepcopy(subject.actions[at])))
    fully = deepcopy(env.reset(seed=subject.seed + 1)[0])
    for i in range(n):
        expected = fully if mask[i] else before
        if found := unlike(subject.rows(after)[i], subject.rows(expected)[i], f"observations[{i}]"):
            those = "a reset of all" if mask[i] else "those before"
            raise Violation(f"a reset of {mask} gave other numbers than {those}: {found}")
        if not mask[i] and (
            found := unlike(subject.rows(stepped[0])[i], subject.rows(undisturbed[0])[i], f"observations[{i}]")
        ):
            raise Violation(f"a reset of {mask} changed how instance {i} goes on: {found}")
    bad: list[tuple[str, Any, type[Exception]]] = [
        ("a list", mask.tolist(), TypeError),
        ("an array of int64", mask.astype(np.int64), TypeError),
        (f"one of shape {(n + 1,)}", np.ones(n + 1, dtype=np.bool_), ValueError),
        ("one without a True", np.zeros(n, dtype=np.bool_), ValueError),
    ]
    for what, wrong, kind in bad:
        subject.advance(at)
        refuses(
            lambda wrong=wrong: env.reset(options={"reset_mask": wrong}), f"the reset mask {what}", (kind, *ASSERTED)
        )
        again = env.step(deepcopy(subject.actions[at]))
        agree(again, undisturbed, f"step {at} after the reset mask {what} had been refused")


def options(subject: Subject) -> None:
    """The caller's dict."""
    given: dict[str, Any] = {}
    if subject.mode is AutoresetMode.DISABLED:
        given["reset_mask"] = np.ones(subject.n, dtype=np.bool_)
    kept = deepcopy(given)
    subject.advance(1)
    subject.env.reset(options=given)
    if found := unlike(given, kept, "options"):
        raise Violation(f"reset(options=...) changed the caller's dict: {found}")


def parity(subject: Subject) -> None:
    """The numbers of singles."""
    if subject.single is None:
        return
    singles = SyncVectorEnv([subject.single] * subject.n, autoreset_mode=subject.mode)
    try:
        for kind in ("single_observation_space", "single_action_space"):
            a, b = getattr(subject.env, kind), getattr(singles, kind)
            demand(a == b, f"{kind} is {a}, but that of the single environment is {b}")
        for (name, got), (_, expected) in zip(subject.run(), subject.run(env=singles), strict=True):
            if found := difference(got, expected):
                raise Violation(f"{name} differs from a SyncVectorEnv of singles: {found}")
    finally:
        singles.close()
