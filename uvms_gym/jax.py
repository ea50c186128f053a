"""The step in JAX: a pure function of arrays with gradients; needs `jax` with 64-bit numbers.

```python
import jax
import jax.numpy as jnp
from uvms_gym import Simulator
from uvms_gym.jax import state, step

jax.config.update("jax_enable_x64", True)
sim = Simulator("bluerov2-heavy", num_envs=8)
start = state(sim)
cost = jax.jit(lambda thrust: jnp.sum(step(sim, start, {"thrust": thrust}, substeps=50)[:, :3] ** 2))
gradient = jax.grad(cost)(jnp.zeros((8, 8)))
```
"""

from collections.abc import Mapping
from functools import partial
from threading import Lock
from typing import Any

import numpy as np

from uvms_gym import _step
from uvms_gym._core import Simulator
from uvms_gym._extras import extra

with extra("jax"):
    import jax
    import jax.numpy as jnp

#: JAX may call from several threads.
_LOCK = Lock()


def state(simulator: Simulator) -> jax.Array:
    """Present states for `step`, in the layout of `uvms_gym.torch.state`."""
    return jnp.asarray(_step.state(simulator))


def step(
    simulator: Simulator,
    state: jax.Array,
    inputs: Mapping[str, jax.Array] | None = None,
    *,
    parameters: Mapping[str, jax.Array] | None = None,
    substeps: int = 1,
) -> jax.Array:
    """Step all instances from `state`; a function of arrays with a vector-Jacobian product, under `jax.jit` too.

    A callback on the host. Arguments, results and errors are as in `uvms_gym.torch.step`, with arrays of float64 (which
    `jax.config.update("jax_enable_x64", True)` enables) in place of tensors.
    """
    inputs, parameters = inputs or {}, parameters or {}
    call = _step.call_of(simulator, inputs, parameters, substeps)
    given = zip(call.arguments, (state, *inputs.values(), *parameters.values()), strict=True)
    next_state: jax.Array = _apply(call, *(_checked(name, value, simulator) for name, value in given))
    return next_state


def _checked(name: str, value: Any, simulator: Simulator) -> jax.Array:
    value = jnp.asarray(value)
    if value.dtype != jnp.float64:
        raise ValueError(
            f"{name} has dtype {value.dtype}, but must have float64: jax.config.update('jax_enable_x64', True)"
        )
    return jnp.broadcast_to(value, _step.shape_of(name, value.shape, simulator))


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _apply(call: _step.Call, *values: jax.Array) -> jax.Array:
    return _forward(call, *values)[0]


def _forward(call: _step.Call, *values: jax.Array) -> tuple[jax.Array, Any]:
    def run(*values: Any) -> tuple[_step.Floats, _step.Floats]:
        with _LOCK:
            return _step.run(call, [np.asarray(value) for value in values])

    results = jax.pure_callback(run, (_like(values[0]), _like(call.simulator.__getstate__())), *values)
    return results[0], (values, *results)


def _backward(call: _step.Call, residuals: Any, cotangent: jax.Array) -> tuple[jax.Array, ...]:
    values, end, checkpoint = residuals

    def run(values: Any, *arrays: Any) -> tuple[_step.Floats, ...]:
        with _LOCK:
            return tuple(_step.pull_back(call, [np.asarray(x) for x in values], *map(np.asarray, arrays)))

    gradients: tuple[jax.Array, ...] = jax.pure_callback(
        run, tuple(map(_like, values)), values, end, checkpoint, cotangent
    )
    return gradients


def _like(array: Any) -> Any:
    shape: Any = jax.ShapeDtypeStruct
    return shape(array.shape, jnp.float64)


_apply.defvjp(_forward, _backward)
