"""Small vector environments: one that keeps Gymnasium's contract, and many that break one rule each."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

SPACE = gym.spaces.Box(-100.0, 100.0, (2,), np.float32)
ACTIONS = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)


class Walk(gym.Env):
    """A point that goes where it is pushed, for two to four steps."""

    observation_space = SPACE
    action_space = ACTIONS
    metadata = {"render_modes": [], "render_fps": 1.0}  # noqa: RUF012

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at = self.np_random.uniform(-1.0, 1.0, 2).astype(np.float32)
        self.left = int(self.np_random.integers(2, 5))
        return self.at.copy(), {"left": self.left}

    def step(self, action):
        self.at = self.at + np.asarray(action, dtype=np.float32)
        self.left -= 1
        return self.at.copy(), float(self.at[0]), self.left == 0, False, {"left": self.left}

    def render(self):
        gym.logger.warn("no render mode")


class Walks(VectorEnv):
    """Many of them, as the contract wants it. Every method is short, so that the toys below can break one each."""

    def __init__(self, mode=AutoresetMode.NEXT_STEP, n=3, render_mode=None):
        self.num_envs = n
        self.mode = mode
        self.render_mode = render_mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 1.0, "autoreset_mode": mode}
        self.single_observation_space, self.single_action_space = SPACE, ACTIONS
        self.observation_space, self.action_space = batch_space(SPACE, n), batch_space(ACTIONS, n)
        self.walks = [Walk() for _ in range(n)]
        self.at = None

    def reset(self, *, seed=None, options=None):
        mask = self.mask(options)
        if isinstance(seed, int) or seed is None:
            seed = [self.seed_of(seed, i) for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds")
        if self.at is None:
            self.at, self.over = np.zeros((self.num_envs, 2), np.float32), np.zeros(self.num_envs, np.bool_)
        for i in np.flatnonzero(mask):
            self.at[i] = self.walks[i].reset(seed=seed[i])[0]
        self.over[mask] = False
        return self.at.copy(), self.infos(mask)

    def seed_of(self, seed, i):
        return None if seed is None else seed + i

    def mask(self, options):
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError("reset_mask must be an array of bool")
        if mask.shape != (self.num_envs,) or not mask.any():
            raise ValueError("reset_mask must pick one of N")
        return mask

    def infos(self, mask):
        return {"left": np.array([w.left for w in self.walks]) * mask, "_left": mask.copy()}

    def check(self, actions):
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape or not np.isfinite(actions).all():
            raise ValueError("bad actions")
        return actions

    def step(self, actions):
        actions = self.check(actions)
        if self.at is None:
            raise gym.error.ResetNeeded("reset first")
        if self.mode is AutoresetMode.DISABLED and self.over.any():
            raise gym.error.ResetNeeded("an episode is over")
        rewards, over = np.zeros(self.num_envs), np.zeros(self.num_envs, np.bool_)
        again = self.over & (self.mode is AutoresetMode.NEXT_STEP)
        for i, walk in enumerate(self.walks):
            if again[i]:
                self.at[i] = walk.reset()[0]
            else:
                self.at[i], rewards[i], over[i] = walk.step(actions[i])[:3]
        infos = self.infos(np.ones(self.num_envs, np.bool_))
        if self.mode is AutoresetMode.SAME_STEP and over.any():
            infos |= self.finals(over)
        self.over = over
        return self.at.copy(), rewards, over.copy(), np.zeros_like(over), infos

    def finals(self, over):
        last = {"final_obs": np.full(self.num_envs, None, object), "final_info": self.infos(over)}
        for i in np.flatnonzero(over):
            last["final_obs"][i] = self.at[i].copy()
            self.at[i] = self.walks[i].reset()[0]
        new = self.infos(np.ones(self.num_envs, np.bool_))
        return new | last | {"_final_obs": over.copy(), "_final_info": over.copy()}

    def render(self):
        if self.render_mode is None:
            gym.logger.warn("no render mode")
            return None
        return tuple(np.zeros((8, 8, 3), np.uint8) for _ in self.walks)


def broken(rule, words, mode=AutoresetMode.NEXT_STEP, **kwargs):
    """Register a toy that breaks one rule, with words of the message."""

    def register(toy):
        TOYS.append(pytest.param(toy, mode, kwargs, rule, words, id=toy.__name__))
        return toy

    return register


TOYS = []
SAME, OFF = AutoresetMode.SAME_STEP, AutoresetMode.DISABLED


@broken("metadata", "is 'NextStep', but must be an instance")
class ModeIsAString(Walks):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.metadata["autoreset_mode"] = "NextStep"


@broken("metadata", "of the class MetadataOfTheClass")
class MetadataOfTheClass(Walks):
    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        del self.metadata


@broken("metadata", "render_mode is 'human'", render_mode="human")
class ModeIsNotListed(Walks):
    pass


@broken("metadata", "render_fps", render_mode="rgb_array")
class NoFrameRate(Walks):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        del self.metadata["render_fps"]


@broken("spaces", "action_space is Box")
class SpaceIsNotBatched(Walks):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.action_space = gym.spaces.Box(-2.0, 2.0, (3, 2), np.float32)


@broken("order", "was taken, but must raise")
class StepsUnreset(Walks):
    def step(self, actions):
        if self.at is None:
            self.reset()
        return super().step(actions)


@broken("order", "AttributeError")
class FallsUnreset(Walks):
    def step(self, actions):
        if self.at is None:
            raise AttributeError("at")
        return super().step(actions)


@broken("results", "observations are an array of float64")
class WideObservations(Walks):
    def step(self, actions):
        observations, *rest = super().step(actions)
        return observations.astype(np.float64), *rest


@broken("results", r"observations\[2, 1\] is .*101.* must lie in \[-100")
class LeavesItsSpace(Walks):
    def step(self, actions):
        observations, *rest = super().step(actions)
        observations[2, 1] = 101.0
        return observations, *rest


@broken("results", "rewards are an array of float32")
class NarrowRewards(Walks):
    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, rewards.astype(np.float32), *rest


@broken("results", "rewards are .*nan.* finite")
class RewardIsNan(Walks):
    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        rewards[1] = np.nan
        return observations, rewards, *rest


@broken("results", "truncations are list")
class FlagsAreAList(Walks):
    def step(self, actions):
        *rest, truncated, infos = super().step(actions)
        return *rest, truncated.tolist(), infos


@broken("results", "must give a tuple of 5")
class GivesFour(Walks):
    def step(self, actions):
        observations, rewards, terminated, _, infos = super().step(actions)
        return observations, rewards, terminated, infos


@broken("infos", "'left' without its mask '_left'")
class NoMask(Walks):
    def infos(self, mask):
        return {"left": super().infos(mask)["left"]}


@broken("infos", "'left'.* is list of shape .* must be an array of 3")
class InfosAreLists(Walks):
    def infos(self, mask):
        return {"left": [w.left for w in self.walks], "_left": mask.copy()}


@broken("seeding", "of a second run with seed 123")
class IgnoresTheSeed(Walks):
    def seed_of(self, seed, i):
        return None


@broken("seeding", "instance 1 must start as with the seed 124")
class SeedsAreSpread(Walks):
    def seed_of(self, seed, i):
        return None if seed is None else seed + 10 * i

    def reset(self, *, seed=None, options=None):
        if isinstance(seed, list) and len(seed) == self.num_envs:
            seed = seed[0]
        return super().reset(seed=seed, options=options)


@broken("seeding", "list of seeds 123")
class IgnoresLists(Walks):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed[0] + 1 if isinstance(seed, list) else seed, options=options)


@broken("seeding", "a list of 4 seeds went through")
class TakesAnyNumberOfSeeds(Walks):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed[:3] if isinstance(seed, list) else seed, options=options)


@broken("seeding", "a reset without a seed after one with seed 123")
class StreamIsNotSeeded(Walks):
    def seed_of(self, seed, i):
        return int(np.random.default_rng().integers(2**31)) if seed is None else seed + i


@broken("fresh", "shares memory with observations of reset")
class OneBuffer(Walks):
    def step(self, actions):
        _, *rest = super().step(actions)
        return self.at, *rest

    def reset(self, *, seed=None, options=None):
        infos = super().reset(seed=seed, options=options)[1]
        return self.at, infos


@broken("fresh", r"infos\['_left'\] of step 0 shares memory with infos\['_left'\] of reset")
class OneMask(Walks):
    def infos(self, mask):
        return super().infos(mask) | {"_left": self.ones} if mask.all() else super().infos(mask)

    @property
    def ones(self):
        self.kept = getattr(self, "kept", np.ones(self.num_envs, np.bool_))
        return self.kept


@broken("fresh", "gives the infos dict of")
class OneDict(Walks):
    kept = None

    def step(self, actions):
        *rest, infos = super().step(actions)
        self.kept = self.kept if self.kept is not None else infos
        self.kept.clear()
        return *rest, self.kept


@broken("fresh", "shares memory with observations of step 0")
class TwoBuffersInTurn(Walks):
    turn = 0

    def step(self, actions):
        observations, *rest = super().step(actions)
        self.buffers = getattr(self, "buffers", [observations.copy(), observations.copy()])
        self.turn = 1 - self.turn
        self.buffers[self.turn][:] = observations
        return self.buffers[self.turn], *rest


@broken("fresh", "read-only")
class ReadOnly(Walks):
    def step(self, actions):
        result = super().step(actions)
        result[1].flags.writeable = False
        return result


@broken("fresh", "after the arrays of earlier results were written to")
class KeepsWhatItGave(Walks):
    def step(self, actions):
        if getattr(self, "given", None) is not None:
            self.at[:] = self.given
            for walk, at in zip(self.walks, self.given, strict=True):
                walk.at = at.copy()
        observations, *rest = super().step(actions)
        # It is given away once, and read the next time.
        self.given = observations
        return observations, *rest

    def reset(self, *, seed=None, options=None):
        self.given = None
        return super().reset(seed=seed, options=options)


@broken("autoreset", "the reward .*, but must give 0")
class RewardsTheReset(Walks):
    def step(self, actions):
        again = None if self.at is None else self.over.copy()
        observations, rewards, *rest = super().step(actions)
        rewards[again] = 1.0
        return observations, rewards, *rest


@broken("autoreset", "says terminated True")
class EndsWithTheReset(Walks):
    def step(self, actions):
        again = None if self.at is None else self.over.copy()
        observations, rewards, terminated, *rest = super().step(actions)
        return observations, rewards, terminated | again, *rest


@broken("autoreset", "gave the first observation of the next one")
class ResetsTooEarly(Walks):
    def step(self, actions):
        again = None if self.at is None else self.over.copy()
        at = None if self.at is None else self.at.copy()
        observations, rewards, terminated, *rest = super().step(actions)
        for i in np.flatnonzero(terminated):
            observations[i] = self.walks[i].reset()[0]
            self.at[i] = observations[i]
        observations[again] = at[again]
        self.at[again] = at[again]
        for i in np.flatnonzero(again):
            self.walks[i].at = at[i]
        return observations, rewards, terminated, *rest


@broken("autoreset", "must ignore its action")
class ActsWithTheReset(Walks):
    def step(self, actions):
        again = None if self.at is None else self.over.copy()
        observations, *rest = super().step(actions)
        observations[again] += np.asarray(actions)[again]
        return observations, *rest


@broken("autoreset", "only AutoresetMode.SAME_STEP gives it")
class FinalsInNextStep(Walks):
    def step(self, actions):
        *rest, terminated, truncated, infos = super().step(actions)
        if terminated.any():
            infos |= {"final_obs": np.full(self.num_envs, None, object), "_final_obs": terminated.copy()}
        return *rest, terminated, truncated, infos


@broken("autoreset", r"infos\['_final_info'\] is .*False.*, but must be", SAME)
class NoFinalInfo(Walks):
    def finals(self, over):
        finals = super().finals(over)
        del finals["final_info"], finals["_final_info"]
        return finals


@broken("autoreset", r"infos\['final_obs'\]\[\d\] is None, but must lie in", SAME)
class NoFinalObservation(Walks):
    def finals(self, over):
        finals = super().finals(over)
        finals["final_obs"][:] = None
        return finals


@broken("autoreset", "gave its last observation, but must give the first one", SAME)
class ResetsTooLate(Walks):
    def step(self, actions):
        *rest, infos = super().step(actions)
        for i, final in enumerate(infos.get("final_obs", [])):
            if final is not None:
                rest[0][i] = final
        return *rest, infos


@broken("autoreset", "though instance .* has ended its episode and autoreset is disabled, went through", OFF)
class StepsOn(Walks):
    def step(self, actions):
        if self.at is not None:
            self.over[:] = False
        return super().step(actions)


@broken("masks", r"infos\['_left'\] = \[ True  True  True\], but it must be \[ True False False\]", OFF)
class MaskOfAll(Walks):
    def infos(self, mask):
        return super().infos(np.ones_like(mask))


@broken("masks", "gave other numbers than those before", OFF)
class ResetsAll(Walks):
    def mask(self, options):
        return np.ones_like(super().mask(options))

    def infos(self, mask):
        return {}


@broken("masks", "the reset mask a list went through", OFF)
class TakesAnyMask(Walks):
    def mask(self, options):
        return np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)), np.bool_)


@broken("masks", r"after the reset mask one of shape \(4,\) had been refused", OFF)
class RefusesTooLate(Walks):
    def mask(self, options):
        try:
            return super().mask(options)
        except ValueError:
            for walk in self.walks:
                walk.at = walk.at + np.float32(1.0)
            raise


@broken("options", "changed the caller's dict: options lacks 'reset_mask'", OFF)
class TakesTheMaskAway(Walks):
    def mask(self, options):
        mask = super().mask(options)
        (options or {}).pop("reset_mask", None)
        return mask


@broken("options", "changed the caller's dict: options has 'at'")
class AddsToTheOptions(Walks):
    def mask(self, options):
        if options is not None:
            options["at"] = 0.0
        return super().mask(options)


@broken("actions", "actions with nan in the last row went through")
class TakesNan(Walks):
    def check(self, actions):
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise ValueError("bad actions")
        return np.nan_to_num(actions)


@broken("actions", r"actions of shape \(2, 2\) instead of \(3, 2\) raised IndexError")
class FallsOverFewActions(Walks):
    def check(self, actions):
        return np.asarray(actions)


@broken("actions", "after actions with nan in the last row had been refused gave other numbers")
class RefusesHalfWay(Walks):
    def check(self, actions):
        try:
            return super().check(actions)
        except ValueError:
            if np.shape(actions) == self.action_space.shape:
                self.walks[0].step(actions[0])
            raise


@broken("render", "must warn")
class SilentWithoutMode(Walks):
    def render(self):
        return None


@broken("render", "gave ndarray of length 3, but must give a sequence", render_mode="rgb_array")
class OneArrayOfPictures(Walks):
    def render(self):
        return np.zeros((3, 8, 8, 3), np.uint8)


@broken("render", r"render\(\)\[0\] is ndarray of dtype float64", render_mode="rgb_array")
class PicturesOfFloats(Walks):
    def render(self):
        return [np.zeros((8, 8, 3))] * 3


@broken("parity", r"rewards\[0\] is .*, not")
class OtherRewards(Walks):
    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return observations, np.where(rewards == 0.0, 0.0, rewards + 1e-12), *rest


@broken("parity", r"infos\['left'\] has dtype int32, not int64")
class OtherInfos(Walks):
    def infos(self, mask):
        infos = super().infos(mask)
        return infos | {"left": infos["left"].astype(np.int32)}


@broken("close", "closed is not True")
class StaysOpen(Walks):
    def close(self):
        pass
