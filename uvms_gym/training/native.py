"""Runs of the learners of this package, from their start or a checkpoint."""

import io
import pickle
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import torch

from uvms_gym._files import write
from uvms_gym.training.asymmetric_ppo import AsymmetricPPO
from uvms_gym.training.distillation import Distillation
from uvms_gym.training.export import write_card
from uvms_gym.training.learner import Learner
from uvms_gym.training.run import (
    BEST,
    POLICY,
    Outcome,
    Record,
    Settings,
    checkpoint_name,
    interrupt_event,
    passed,
)
from uvms_gym.training.shac import Shac

#: Learners by the name of the algorithm.
LEARNERS: dict[str, type[Learner]] = {"distill": Distillation, "asymmetric-ppo": AsymmetricPPO, "shac": Shac}


def make_learner(settings: Settings) -> Learner:
    """Make an untrained learner; errors as of its class.

    Torch has one thread: its sums would depend on their number, and the learner's own threads use the other cores.
    """
    torch.set_num_threads(1)
    return LEARNERS[settings.algo](settings)  # type: ignore[call-arg]


def check(settings: Settings) -> None:
    """Make the learner once: errors as in its class."""
    make_learner(settings).close()


def save(learner: Learner, seconds: float, path: Path) -> None:
    """Write a checkpoint with the time so far, s.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    data = io.BytesIO()
    torch.save({"seconds": seconds, "algo": learner.settings.algo, **learner.state()}, data)
    write(path, data.getvalue())


def load(learner: Learner, path: Path) -> float:
    """Continue from a checkpoint; returns the time so far, s.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is of another kind, or for other settings.
    """
    try:
        # Only numbers: nothing in the file is executed.
        state = torch.load(path, weights_only=True)
        if state["algo"] != learner.settings.algo:
            raise ValueError(f"algorithm {state['algo']}")
        learner.set_state(state)
    except (RuntimeError, ValueError, LookupError, TypeError, EOFError, pickle.UnpicklingError):
        raise ValueError(f"{path} holds no training run of `uvms train --algo {learner.settings.algo}`") from None
    return float(state["seconds"])


def train(
    settings: Settings,
    folder: Path,
    *,
    agent: Path | None = None,
    tensorboard_log: Path | None = None,
    verbose: int = 0,
    origin: Mapping[str, str] | None = None,
    tick: Callable[[int], object] = lambda steps: None,
    report: Callable[[dict[str, Any]], object] = lambda evaluation: None,
    interrupted: threading.Event | None = None,
) -> Outcome:
    """Train, evaluate, write checkpoints and export the policy, all in `folder`.

    Parameters, errors and stops as in `uvms_gym.training.ppo.train`; `verbose` has no effect. `interrupted` stops the
    run in place of signals.
    """
    learner = make_learner(settings)
    before = 0.0 if agent is None else load(learner, agent)
    record = Record(settings, folder, learner.envs.inner, time.perf_counter() - before, origin or {}, report)
    if agent is not None:
        record.resume(learner.steps)
    if learner.left == 0.0:
        record.refuse(learner.steps)
    settings.save(folder)
    writer = None
    if tensorboard_log is not None:
        from torch.utils.tensorboard import SummaryWriter

        writer = SummaryWriter(str(tensorboard_log / folder.name))

    def evaluate() -> None:
        policy = learner.actor.policy(learner.envs.inner)
        scores, best = record.evaluate(policy, learner.steps)
        if writer is not None:
            for name, value in scores.items():
                writer.add_scalar(f"eval/{name}", value, learner.steps)
        if best:
            save(learner, record.seconds, folder / BEST)

    with interrupt_event() if interrupted is None else nullcontext(interrupted) as asked:
        if not record.curve and settings.eval_freq > 0:
            evaluate()
        while learner.left > 0.0 and not asked.is_set():
            previous = learner.steps
            learner.iterate()
            steps = learner.steps
            tick(steps - previous)
            if passed(settings.eval_freq, previous, steps):
                evaluate()
            if passed(settings.save_freq, previous, steps):
                save(learner, record.seconds, folder / checkpoint_name(steps))
        finished = learner.left == 0.0
        checkpoint = folder / (f"{settings.env}.zip" if finished else checkpoint_name(learner.steps))
        save(learner, record.seconds, checkpoint)
        if not record.curve or record.curve[-1]["steps"] != learner.steps:
            evaluate()
        notes = record.notes(learner.steps, torch.get_num_threads(), learner.notes())
        learner.actor.policy(learner.envs.inner, notes).save(folder / POLICY)
        write_card(folder)
    if writer is not None:
        writer.close()
    learner.close()
    return Outcome(learner.steps, record.seconds, finished, checkpoint, folder / POLICY, record.curve[-1])
