"""Policies as one C file without dependencies (C99): the arithmetic of the native policy, in the same order."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from uvms_gym.export.policy import ERRORS, PolicyModel

_HEAD = """\
/* Neural policy {title}.
 *
 * Written by `uvms export`; {contract} states names, units and frames of all inputs and actions.
 * Scene {scene}, digest {digest}.
 *
 * policy_reset once before each episode, then policy_step once every {period:.9g} s:
 *   input   physical values in the order below; one that is NaN or infinite is missing, and its last value counts
 *   action  entries in [-1, 1]
 * policy_observe and policy_act are the two halves of policy_step. Where another action than the policy's was applied,
 * write it to `action` of the state. No memory is allocated, and nothing is kept outside of the state.
 *
{inputs}
 *
 * Bits equal those of the simulator's own policy if the compiler neither contracts nor reorders operations: no
 * -ffast-math. -O3 -march=native makes fmaf one instruction where the processor has it.
 */
#include <math.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

#define POLICY_INPUTS {m}
#define POLICY_OBSERVATION {d}
#define POLICY_ACTIONS {a}

typedef struct {{
    double input[POLICY_INPUTS];    /* last values that were there */
{members}    double integral[{errors}];             /* leaky integral of the pose error */
    float action[POLICY_ACTIONS];   /* last action */
    int started;
}} policy_state;

void policy_reset(policy_state *state);
void policy_observe(policy_state *state, const double input[POLICY_INPUTS], float observation[POLICY_OBSERVATION]);
void policy_act(policy_state *state, const float observation[POLICY_OBSERVATION], float action[POLICY_ACTIONS]);
void policy_step(policy_state *state, const double input[POLICY_INPUTS], float action[POLICY_ACTIONS]);

"""
_FUNCTIONS = """\
void policy_reset(policy_state *state) {{
    static const policy_state start; /* zeros */
    *state = start;
}}

static float policy_scaled(double value, int k) {{
    double x = value * per_unit[k];
    x = x < bound[k] ? x : bound[k];
    return (float)(x > -bound[k] ? x : -bound[k]);
}}

void policy_observe(policy_state *state, const double input[POLICY_INPUTS], float observation[POLICY_OBSERVATION]) {{
    double used[POLICY_INPUTS];
    int k;
    for (k = 0; k < POLICY_INPUTS; k++) {{
        if (fabs(input[k]) <= 1.7976931348623157e308)
            state->input[k] = input[k];
        else if (!state->started)
            state->input[k] = NAN;
        used[k] = state->input[k];
    }}
{delay}    for (k = 0; k < {errors}; k++)
        if (state->started && used[k] == used[k])
            state->integral[k] = fma(used[k], {gain}, state->integral[k] * {keep});
    state->started = 1;
    for (k = 0; k < POLICY_INPUTS; k++)
        observation[k] = policy_scaled(used[k], k);
    for (k = 0; k < POLICY_ACTIONS; k++)
        observation[POLICY_INPUTS + k] = policy_scaled(state->action[k], POLICY_INPUTS + k);
    for (k = 0; k < {errors}; k++)
        observation[{integral} + k] = policy_scaled(state->integral[k], {integral} + k);
}}

static void policy_layer(
    const float *weights, const float *biases, int inputs, int outputs, const float *restrict x, float *restrict y) {{
    int i, k;
    for (k = 0; k < outputs; k++)
        y[k] = biases[k];
    for (i = 0; i < inputs; i++)
        for (k = 0; k < outputs; k++)
            y[k] = fmaf(x[i], weights[i * outputs + k], y[k]);
}}

static float policy_clip(float x, float limit) {{
    x = x < limit ? x : limit;
    return x > -limit ? x : -limit;
}}
{activation}
void policy_act(policy_state *state, const float observation[POLICY_OBSERVATION], float action[POLICY_ACTIONS]) {{
    float x[{width}], y[{width}];
    int k;
{stack}{normalise}{layers}    for (k = 0; k < POLICY_ACTIONS; k++)
        state->action[k] = action[k] = {output}({last}[k]{limit});
}}

void policy_step(policy_state *state, const double input[POLICY_INPUTS], float action[POLICY_ACTIONS]) {{
    float observation[POLICY_OBSERVATION];
    policy_observe(state, input, observation);
    policy_act(state, observation, action);
}}
"""
_DELAY = """\
    /* Measurements are held back by {delay} control periods; the first one counts for all before it. */
    for (k = 0; k < POLICY_INPUTS; k++) {{
        int i, slot = state->slot;
        if (!state->started)
            for (i = 0; i < {delay}; i++)
                state->delayed[i][k] = used[k];
        if (delayed[k]) {{
            double oldest = state->delayed[slot][k];
            state->delayed[slot][k] = used[k];
            used[k] = oldest;
        }}
    }}
    state->slot = (state->slot + 1) % {delay};
"""
_STACK = """\
    for (k = 0; k < {past}; k++)
        x[k] = state->history[k];
    for (k = 0; k < POLICY_OBSERVATION; k++)
        x[{past} + k] = observation[k];
"""
_STORE = """\
    for (k = 0; k < {past}; k++)
        state->history[k] = x[POLICY_OBSERVATION + k];
"""
_NORMALISE = """\
    for (k = 0; k < {inputs}; k++)
        x[k] = policy_clip((x[k] - mean[k]) * factor[k], {clip});
"""
# The coefficients and the order of the operations are those of `src/lane/elementary.rs`.
_TANH = """
/* Hyperbolic tangent to 6 units in the last place. */
static float policy_tanh(float x) {{
    float z, over, under;
    x = policy_clip(x, {edge});
    z = x * x;
    over = fmaf(fmaf(fmaf(fmaf({a4}, z, {a3}), z, {a2}), z, {a1}), z, {a0});
    under = fmaf(fmaf(fmaf(fmaf({b4}, z, {b3}), z, {b2}), z, {b1}), z, {b0});
    return policy_clip(x * over / under, 1.0f);
}}
"""
_ELU = """
static float policy_elu(float x) {
    float t = policy_tanh((x < 0.0f ? x : 0.0f) * 0.5f);
    return 0.0f < x ? x : (t + t) / (1.0f - t);
}
"""
_RELU = """
static float policy_relu(float x) {
    return x > 0.0f ? x : 0.0f;
}
"""
#: Bound and coefficients of tanh x / x as a ratio of polynomials in x^2.
TANH_EDGE = 9.01
TANH = (
    (0.999999979, 0.133803749, 3.49481494e-3, 2.05963342e-5, 1.33369244e-8),
    (1.0, 0.467136904, 2.58740418e-2, 3.28436943e-4, 7.76931576e-7),
)


def export(model: PolicyModel, contract: str = "its contract") -> str:
    """C text of a policy; `contract` is the name of the contract's file."""
    facts, past, m = model.contract, model.past, model.inputs
    width = max(max(weights.shape) for weights, _ in model.layers)
    head = _HEAD.format(
        title=f"for {facts['task']}",
        contract=contract,
        scene=facts["scene"]["name"],
        digest=facts["scene"]["digest"],
        period=facts["control_period"],
        inputs="\n".join(f" *   {k:3d}  {entry['name']}, {entry['unit']}" for k, entry in _inputs(facts)),
        m=m,
        d=model.observation,
        a=model.actions,
        errors=ERRORS,
        members=_members(model),
    )
    tables = [
        _table("double", "per_unit", 1.0 / model.scale),
        _table("double", "bound", model.bound),
        *([_table("char", "delayed", model.delayed.astype(int))] if model.delay else []),
    ]
    normalise = ""
    if model.normalisation is not None:
        mean, factor, limit = model.normalisation
        tables += [_table("float", "mean", mean), _table("float", "factor", factor)]
        normalise = _NORMALISE.format(inputs=past + model.observation, clip=_float(float(limit)))
    for k, (weights, biases) in enumerate(model.layers):
        # One row per input, so that the outputs' sums advance side by side.
        tables += [_table("float", f"weights_{k}", weights.T.ravel()), _table("float", f"biases_{k}", biases)]
    body = _FUNCTIONS.format(
        delay=_DELAY.format(delay=model.delay) if model.delay else "",
        errors=ERRORS,
        gain=_double(facts["integral"]["gain"]),
        keep=_double(facts["integral"]["keep"]),
        integral=m + model.actions,
        activation=_activation(model),
        width=width,
        stack=_STACK.format(past=past) + _STORE.format(past=past)
        if past
        else "    for (k = 0; k < POLICY_OBSERVATION; k++)\n        x[k] = observation[k];\n",
        normalise=normalise,
        layers=_layers(model),
        output="policy_tanh" if model.output == "tanh" else "policy_clip",
        last="xy"[len(model.layers) % 2],
        limit="" if model.output == "tanh" else ", 1.0f",
    )
    return head + "".join(tables) + "\n" + body


def _inputs(facts: dict[str, Any]) -> Iterable[tuple[int, dict[str, Any]]]:
    return enumerate(facts["observation"][: len(facts["inputs"])])


def _members(model: PolicyModel) -> str:
    lines = []
    if model.delay:
        lines.append(f"    double delayed[{model.delay}][POLICY_INPUTS];\n    int slot;\n")
    if model.past:
        lines.append(f"    float history[{model.past}]; /* observations before the present one, oldest first */\n")
    return "".join(lines)


def _layers(model: PolicyModel) -> str:
    lines = []
    for k, (weights, _) in enumerate(model.layers):
        (outputs, inputs), (source, result) = weights.shape, ("xy", "yx")[k % 2]
        lines.append(f"    policy_layer(weights_{k}, biases_{k}, {inputs}, {outputs}, {source}, {result});\n")
        if k + 1 < len(model.layers):
            lines.append(f"    for (k = 0; k < {outputs}; k++)\n")
            lines.append(f"        {result}[k] = policy_{model.activation}({result}[k]);\n")
    return "".join(lines)


def _activation(model: PolicyModel) -> str:
    several = len(model.layers) > 1
    text = ""
    if model.output == "tanh" or (several and model.activation in ("tanh", "elu")):
        over, under = ({f"{n}{k}": _float(c) for k, c in enumerate(row)} for n, row in zip("ab", TANH))
        text += _TANH.format(edge=_float(TANH_EDGE), **over, **under)
    if several:
        text += {"elu": _ELU, "relu": _RELU}.get(model.activation, "")
    return text


def _table(kind: str, name: str, values: Any) -> str:
    """Constant array, several numbers a line."""
    writers: dict[str, Callable[[Any], str]] = {"double": _double, "float": _float, "char": str}
    write = writers[kind]
    numbers = [write(value) for value in values]
    rows = (", ".join(numbers[k : k + 8]) for k in range(0, len(numbers), 8))
    return f"static const {kind} {name}[{len(numbers)}] = {{\n" + "".join(f"    {row},\n" for row in rows) + "};\n"


def _double(value: float) -> str:
    return _pointed(f"{value:.17g}")


def _float(value: float) -> str:
    return _pointed(f"{np.float32(value):.9g}") + "f"


def _pointed(text: str) -> str:
    return text if any(mark in text for mark in ".en") else f"{text}.0"
