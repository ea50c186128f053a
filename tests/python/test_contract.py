"""Contract of Gymnasium for single and for vector environments, for every id."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from helpers import arrays_of, assert_apart, control_rate, idle, make, other_than, same, task_ids

pytestmark = pytest.mark.parametrize("task", task_ids())
#: Single environments, and vectors of three.
BOTH = pytest.mark.parametrize("n", [None, 3], ids=["single", "vector"])


def reset_and_step(task, n, actions):
    env = make(task, n).unwrapped
    env.reset(seed=0)
    return env.step(actions)


RECREATE = {
    "spec": lambda spec: spec,
    "pickle": lambda spec: pickle.loads(pickle.dumps(spec)),
    "json": lambda spec: EnvSpec.from_json(spec.to_json()),
}
MODES = [mode for member in AutoresetMode for mode in (member, member.value)]


@pytest.mark.parametrize(
    ("n", "kind", "mode"),
    [(None, "pickle", None), (None, "json", None), *((3, kind, mode) for kind in ("spec", "pickle") for mode in MODES)],
)
def test_a_spec_recreates_the_environment(task, n, kind, mode):
    more = {"autoreset_mode": mode, "threads": 2, "copy": False, "render_mode": None} if n else {}
    env = make(task, n, action="thrusters", reward={"pose": 0.2}, substeps=2, max_episode_steps=3, **more)
    again = (gym.make_vec if n else gym.make)(RECREATE[kind](env.spec))
    assert again.metadata == env.metadata
    assert same(again.reset(seed=1), env.reset(seed=1))
    for _ in range(3):
        got, expected = again.step(idle(env)), env.step(idle(env))
        assert same(got, expected)
    assert np.all(got[3])


@BOTH
def test_results_are_the_callers_own(task, n):
    env = make(task, n)
    results = [env.reset(seed=0), *(env.step(idle(env)) for _ in range(3)), env.reset()]
    arrays = [array for result in results for array in arrays_of(result)]
    assert all(array.flags.writeable for array in arrays)
    assert_apart(arrays)
    assert len({id(result[-1]) for result in results}) == len(results)
    # What a caller writes does not come back.
    one, other = make(task, n), make(task, n)
    for env in (one, other):
        env.reset(seed=0)
    for k in range(4):
        got, expected = one.step(other_than(k, one)), other.step(other_than(k, other))
        assert same(got, expected)
        for array in arrays_of(got):
            array[:] = 7
        got[-1].clear()


@BOTH
def test_without_a_seed_the_operating_system_gives_one(task, n):
    one, other = make(task, n), make(task, n)
    first, _ = one.reset()
    assert not same(other.reset()[0], first)
    assert same(other.reset(seed=one.unwrapped.np_random_seed)[0], first)
    assert n is None or not same(first[0], first[1])


@BOTH
def test_a_step_before_the_first_reset_is_refused(task, n):
    for env in (make(task, n), make(task, n).unwrapped):
        with pytest.raises(gym.error.ResetNeeded, match="reset"):
            env.step(idle(env))


@BOTH
def test_episodes_are_truncated_by_their_own_limit(task, n):
    env = make(task, n, substeps=1)
    env.reset(seed=0)
    ends = np.array([env.step(idle(env))[2:4] for _ in range(gym.spec(task).max_episode_steps)])
    assert not ends[:, 0].any() and not ends[:-1, 1].any() and ends[-1, 1].all()
    # Gymnasium's wrapper limits single environments.
    endless = [make(task, 1, substeps=1, max_episode_steps=never) for never in (None, 0)]
    for env in endless if n else [make(task, substeps=1).unwrapped]:
        env.reset(seed=0)
        assert not any(np.any(env.step(idle(env))[3]) for _ in range(420))


BAD = {
    "nan": lambda a: np.append(np.nan, a.flat[1:]).reshape(a.shape),
    "last nan": lambda a: np.append(a.flat[:-1], np.nan).reshape(a.shape),
    "inf": lambda a: np.append(a.flat[:-1], np.inf).reshape(a.shape),
    "all inf": lambda a: a + np.inf,
    "-inf": lambda a: a - np.inf,
    "masked": lambda a: np.ma.array(a, mask=a == a),
    "short": lambda a: a[:-1],
    "narrow": lambda a: a[..., :-1],
    "long": lambda a: np.append(a, 0.0),
    "deep": lambda a: a[None],
    "one": lambda a: a[0],
    "text": lambda a: a.astype(str),
    "word": lambda a: "idle",
    "complex": lambda a: a.astype(complex),
    "none": lambda a: None,
    "empty": lambda a: [],
    "ragged": lambda a: [1.0, [2.0]],
}


@BOTH
@pytest.mark.parametrize("name", BAD)
def test_bad_actions_are_refused_and_change_nothing(task, n, name):
    env = make(task, n).unwrapped
    env.reset(seed=0)
    env.step(other_than(0, env))
    before = env.get_state()
    with pytest.raises(ValueError, match=r"^action") as refused:
        env.step(BAD[name](idle(env)))
    assert list(BAD).index(name) < list(BAD).index("short") or str(env.action_space.shape) in str(refused.value)
    # One error, not one on top of another.
    assert refused.value.__context__ is None or refused.value.__suppress_context__
    assert same(env.get_state(), before)


@BOTH
def test_actions_are_read_wherever_they_lie(task, n):
    actions = other_than(2, make(task, n))
    frozen = actions.copy()
    frozen.flags.writeable = False
    strided = np.full([3 * size for size in actions.shape], np.nan, dtype=np.float32)
    strided = strided[::3] if n is None else strided[::3, ::3]
    strided[:] = actions
    odd = np.frombuffer(b"\0" + actions.tobytes(), dtype=np.float32, offset=1).reshape(actions.shape)
    assert not odd.flags.aligned
    expected = reset_and_step(task, n, actions)
    for given in (frozen, strided, actions[::-1].copy()[::-1], np.asfortranarray(actions), odd):
        assert same(reset_and_step(task, n, given), expected)


@BOTH
@pytest.mark.parametrize("dtype", [np.float64, np.float16, np.int64, np.uint8])
def test_actions_of_any_real_type_are_clipped(task, n, dtype):
    wild = np.abs(other_than(1, make(task, n), 4.0)).astype(dtype)
    wild.flat[:3] = 0, 1, 100
    if dtype is np.float64:
        wild.flat[:2] = 1e300, -1e300
    clipped = np.clip(wild.astype(np.float64), -1.0, 1.0).astype(np.float32)
    assert same(reset_and_step(task, n, wild), reset_and_step(task, n, clipped))


def copies(env, fresh):
    """The environment as it stands, in all ways that there are."""
    yield copy.deepcopy(env)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        yield pickle.loads(pickle.dumps(env, protocol))
    fresh.reset()
    fresh.unwrapped.set_state(env.unwrapped.get_state())
    yield fresh


@pytest.mark.parametrize(
    ("n", "options"),
    [
        (None, {}),
        (3, {"max_episode_steps": 6, "autoreset_mode": "NextStep", "dtype": "float64"}),
        (3, {"max_episode_steps": 6, "autoreset_mode": "SameStep", "dtype": "float32"}),
    ],
)
def test_copies_in_mid_episode_go_on_alike_and_apart(task, n, options):
    env = make(task, n, **options)
    env.reset(seed=11)
    for k in range(4):
        env.step(other_than(k, env))
    state = env.unwrapped.get_state()
    others = list(copies(env, make(task, n, **options)))
    results = [[other.step(other_than(k, env)) for k in range(8)] + [other.reset()] for other in others]
    assert same(env.unwrapped.get_state(), state)
    # The stream of episodes goes on alike, too.
    expected = [env.step(other_than(k, env)) for k in range(8)] + [env.reset()]
    assert all(same(result, expected) for result in results)


@BOTH
def test_frame_rate_is_the_control_rate(task, n):
    one, other, third = make(task, n), make(task, n, substeps=1), make(task, n, dt=0.02, substeps=1)
    rates = [control_rate(task), 1.0 / one.unwrapped.snapshot().dt, 50.0]
    assert [env.metadata["render_fps"] for env in (one, other, third)] == rates
    assert n or type(one.unwrapped).metadata["render_fps"] == 20.0


@BOTH
def test_rendering_without_a_mode_warns(task, n):
    env = make(task, n)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render mode"):
        assert env.unwrapped.render() == (n and (None,) * n)
