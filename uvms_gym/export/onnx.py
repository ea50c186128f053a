"""Policies as ONNX graphs: scaling, history, delay and memory are in the graph; the memory is inputs and outputs.

A runtime may add the terms of a matrix product in any order, and in single precision the result then differs from the
native policy by several 1e-6. The graph therefore adds them one by one, with a fused multiply-add as the native policy
does: the product of two single numbers is exact in double precision, and the sum is rounded to single.
"""

import json
from typing import Any

import numpy as np

from uvms_gym._extras import extra
from uvms_gym.export.c import TANH, TANH_EDGE
from uvms_gym.export.policy import ERRORS, PolicyModel, Singles

#: Version of the operators, and of the format, which runtimes since 2022 read.
OPSET, FORMAT = 17, 8
_LARGEST = np.finfo(np.float64).max


class _Graph:
    """Nodes and constants, each under a name of its own."""

    def __init__(self, prefix: str = "") -> None:
        with extra("onnx"):
            import onnx

        self.onnx: Any = onnx
        self.prefix = prefix
        self.nodes: list[Any] = []
        self.constants: dict[tuple[Any, ...], Any] = {}

    def constant(self, value: Any, dtype: Any) -> str:
        array = np.asarray(value, dtype=dtype)
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self.constants:
            self.constants[key] = self.onnx.numpy_helper.from_array(array, f"constant_{len(self.constants)}")
        return str(self.constants[key].name)

    def __call__(self, kind: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        name = name or f"{self.prefix}{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(kind, list(inputs), [name], **attributes))
        return name

    def fused(self, a: str, b: str, c: str) -> str:
        """`a b + c` in single precision, rounded once; `a` and `b` are in double."""
        total = self("Add", self("Mul", a, b), self("Cast", c, to=self.onnx.TensorProto.DOUBLE))
        return self("Cast", total, to=self.onnx.TensorProto.FLOAT)

    def columns(self, x: str, first: int, end: int) -> str:
        return self("Slice", x, *(self.constant([k], np.int64) for k in (first, end, 1)))

    def clip(self, x: str, limit: Any, dtype: Any) -> str:
        return self("Max", self("Min", x, self.constant(limit, dtype)), self.constant(-np.asarray(limit), dtype))


def export(model: PolicyModel) -> bytes:
    """ONNX file of a policy."""
    graph, double, single = _Graph(), np.float64, np.float32
    m, d, a = model.inputs, model.observation, model.actions
    states: dict[str, tuple[int, Any]] = {
        "state_input": (m, double),
        "state_integral": (ERRORS, double),
        "state_action": (a, single),
    }
    if model.delay:
        states["state_delayed"] = (model.delay * m, double)
    if model.past:
        states["state_history"] = (model.past, single)
    states["state_started"] = (1, np.bool_)

    def finite(x: str) -> str:
        return graph("LessOrEqual", graph("Abs", x), graph.constant(_LARGEST, double))

    # Missing inputs keep their last value; before the first they are NaN.
    last = graph("Where", "state_started", "state_input", graph.constant(np.nan, double))
    used = present = graph("Where", finite("input"), "input", last, name="next_state_input")
    if model.delay:
        first = graph("Concat", *[present] * model.delay, axis=1)
        stored = graph("Concat", graph("Where", "state_started", "state_delayed", first), present, axis=1)
        oldest = graph.columns(stored, 0, m)
        used = graph("Where", graph.constant(model.delayed, np.bool_), oldest, present)
        graph("Identity", graph.columns(stored, m, (model.delay + 1) * m), name="next_state_delayed")
    errors, integral = graph.columns(used, 0, ERRORS), model.contract["integral"]
    sums = [("state_integral", integral["keep"]), (errors, integral["gain"])]
    grown = graph("Add", *(graph("Mul", x, graph.constant(by, double)) for x, by in sums))
    advances = graph("And", "state_started", finite(errors))
    now = graph("Where", advances, grown, "state_integral", name="next_state_integral")
    values = graph("Concat", used, graph("Cast", "state_action", to=graph.onnx.TensorProto.DOUBLE), now, axis=1)
    scaled = graph.clip(graph("Mul", values, graph.constant(1.0 / model.scale, double)), model.bound, double)
    bounded = graph("Where", finite(values), scaled, graph.constant(model.bound, double))
    x = graph("Cast", bounded, to=graph.onnx.TensorProto.FLOAT, name="observation")
    if model.past:
        x = graph("Concat", "state_history", x, axis=1)
        graph("Identity", graph.columns(x, d, d + model.past), name="next_state_history")
    if model.normalisation is not None:
        mean, factor, clip = model.normalisation
        x = graph("Mul", graph("Sub", x, graph.constant(mean, single)), graph.constant(factor, single))
        x = graph.clip(x, clip, single)
    for k, (weights, biases) in enumerate(model.layers):
        x = _layer(graph, x, weights, biases)
        if k + 1 < len(model.layers):
            x = _activation(graph, x, model.activation)
    x = _tanh(graph, x) if model.output == "tanh" else graph.clip(x, 1.0, single)
    graph("Identity", x, name="action")
    graph("Identity", x, name="next_state_action")
    everything = graph.constant([[True]], np.bool_)
    graph("Or", "state_started", everything, name="next_state_started")

    helper, convert = graph.onnx.helper, graph.onnx.helper.np_dtype_to_tensor_dtype

    def value(name: str, width: int, dtype: Any) -> Any:
        return helper.make_tensor_value_info(name, convert(np.dtype(dtype)), ["n", width])

    made = helper.make_graph(
        graph.nodes,
        "policy",
        [value("input", m, double), *(value(name, *shape) for name, shape in states.items())],
        [
            value("action", a, single),
            value("observation", d, single),
            *(value(f"next_{name}", *shape) for name, shape in states.items()),
        ],
        list(graph.constants.values()),
    )
    file = helper.make_model(made, ir_version=FORMAT, opset_imports=[helper.make_opsetid("", OPSET)])
    helper.set_model_props(file, {"contract": json.dumps(model.contract)})
    graph.onnx.checker.check_model(file, full_check=True)
    return bytes(file.SerializeToString())


def _layer(graph: _Graph, x: str, weights: Singles, biases: Singles) -> str:
    """`W x + b`: a loop over the inputs, with all outputs side by side."""
    helper, kinds, outputs = graph.onnx.helper, graph.onnx.TensorProto, len(biases)
    step = _Graph("step_")
    sums = step.fused("input", "column", "sums")
    body = helper.make_graph(
        step.nodes,
        "add_input",
        [
            helper.make_tensor_value_info("sums", kinds.FLOAT, ["n", outputs]),
            helper.make_tensor_value_info("input", kinds.DOUBLE, ["n", 1]),
            helper.make_tensor_value_info("column", kinds.DOUBLE, [outputs]),
        ],
        [helper.make_tensor_value_info(sums, kinds.FLOAT, ["n", outputs])],
    )
    rows = graph("Shape", x, start=0, end=1)
    shape = graph("Concat", rows, graph.constant([outputs], np.int64), axis=0)
    start = graph("Expand", graph.constant(biases, np.float32), shape)
    inputs = graph("Transpose", graph("Cast", x, to=kinds.DOUBLE), perm=[1, 0])
    one_by_one = graph("Unsqueeze", inputs, graph.constant([2], np.int64))
    return graph("Scan", start, one_by_one, graph.constant(weights.T, np.float64), body=body, num_scan_inputs=2)


def _activation(graph: _Graph, x: str, kind: str) -> str:
    if kind == "tanh":
        return _tanh(graph, x)
    if kind == "relu":
        return graph("Relu", x)
    zero, half, one = (graph.constant(number, np.float32) for number in (0.0, 0.5, 1.0))
    t = _tanh(graph, graph("Mul", graph("Min", x, zero), half))
    return graph("Where", graph("Less", zero, x), x, graph("Div", graph("Add", t, t), graph("Sub", one, t)))


def _tanh(graph: _Graph, x: str) -> str:
    """The native policy's tanh, which differs from the exact one by up to 6 units in the last place."""
    x = graph.clip(x, TANH_EDGE, np.float32)
    z = graph("Mul", x, x)
    over, under = (_horner(graph, z, row) for row in TANH)
    return graph.clip(graph("Div", graph("Mul", x, over), under), 1.0, np.float32)


def _horner(graph: _Graph, z: str, row: tuple[float, ...]) -> str:
    wide = graph("Cast", z, to=graph.onnx.TensorProto.DOUBLE)
    total = graph.constant(row[-1], np.float32)
    for number in reversed(row[:-1]):
        total_wide = graph("Cast", total, to=graph.onnx.TensorProto.DOUBLE)
        total = graph.fused(total_wide, wide, graph.constant(number, np.float32))
    return total
