"""The U-net as ONNX: eight convolutions of 3x3, 64 activations, residual links.

Beyond Blur (Walton et al. 2021), section 5.3, after Ronneberger, Fischer and Brox 2015, "U-Net":
three halvings by the greatest of 2x2, three doublings by repetition, and the way down added to the
way up. The networks for moments and for colour differ in the last layer's channels alone.

`weights` are pairs (kernel, bias), kernels of shape (out, in, 3, 3).
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.denoising.maps import BLOCK_PX
from pipeline.denoising.network import FACTS_KEY, VALUES, Kind, NetworkFacts, inputs_of

Array = NDArray[np.float32]
Weights = list[tuple[Array, Array]]

ACTIVATIONS = 64
LAYERS = 8
COLOURS = 3
OPSET = 17


def outputs_of(kind: Kind, levels: int) -> int:
    """Channels of the last layer."""
    return COLOURS + (VALUES * levels if kind == "moments" else 0)


def first_weights(kind: Kind, levels: int, seed: int) -> Weights:
    """Random weights (He et al. 2015); all but the last layer's are the same for both kinds."""
    rng = np.random.default_rng(seed)
    channels = [inputs_of(levels), *([ACTIVATIONS] * (LAYERS - 1)), outputs_of(kind, levels)]
    found: Weights = []
    for layer in range(LAYERS):
        taken, given = channels[layer], channels[layer + 1]
        gain = 2.0 if layer < LAYERS - 1 else 1.0
        kernel = rng.standard_normal((given, taken, 3, 3)) * np.sqrt(gain / (9 * taken))
        found.append((kernel.astype(np.float32), np.zeros(given, np.float32)))
    return found


def as_json(facts: NetworkFacts) -> str:
    """Text of a file's metadata."""
    return json.dumps({"version": 2, **asdict(facts)}, sort_keys=True)


def to_onnx(weights: Weights, facts: NetworkFacts) -> bytes:
    """The network as an ONNX file; equal weights and facts give equal bytes."""
    from onnx import TensorProto, helper, numpy_helper

    nodes: list[Any] = []
    held = [numpy_helper.from_array(np.array([1, 1, 2, 2], np.float32), "twice")]
    for index, (kernel, bias) in enumerate(weights):
        held.append(numpy_helper.from_array(np.ascontiguousarray(kernel, np.float32), f"k{index}"))
        held.append(numpy_helper.from_array(np.ascontiguousarray(bias, np.float32), f"b{index}"))

    def add(kind: str, takes: Sequence[str], gives: str, **settings: Any) -> str:
        nodes.append(helper.make_node(kind, list(takes), [gives], name=gives, **settings))
        return gives

    def layer(index: int, takes: str, gives: str) -> str:
        return add("Conv", (takes, f"k{index}", f"b{index}"), gives, pads=[1] * 4)

    def active(index: int, takes: str) -> str:
        return add("Relu", (layer(index, takes, f"conv{index}"),), f"active{index}")

    down = [active(0, "noisy")]
    for index in (1, 2, 3):
        half = add("MaxPool", (down[-1],), f"half{index}", kernel_shape=[2, 2], strides=[2, 2])
        down.append(active(index, half))
    up = down[3]
    for index in (4, 5, 6):
        wide = add(
            "Resize", (up, "", "twice"), f"wide{index}", mode="nearest",
            coordinate_transformation_mode="asymmetric", nearest_mode="floor",
        )  # fmt: skip
        up = active(index, add("Add", (wide, down[6 - index]), f"sum{index}"))
    outputs = [
        helper.make_tensor_value_info("base", TensorProto.FLOAT, [1, COLOURS, "height", "width"])
    ]
    if facts.kind == "rgb":
        layer(7, up, "base")
    else:
        count = VALUES * facts.levels
        held.append(numpy_helper.from_array(np.array([COLOURS, count], np.int64), "parts"))
        all_of_them = layer(7, up, "all")
        nodes.append(
            helper.make_node(
                "Split", [all_of_them, "parts"], ["base", "fine"], name="split", axis=1
            )
        )
        block = [BLOCK_PX, BLOCK_PX]
        add("AveragePool", ("fine",), "maps", kernel_shape=block, strides=block)
        shape: list[str | int | None] = [1, count, "block_rows", "block_columns"]
        outputs.append(helper.make_tensor_value_info("maps", TensorProto.FLOAT, shape))
    taken: list[str | int | None] = [1, inputs_of(facts.levels), "height", "width"]
    fed = helper.make_tensor_value_info("noisy", TensorProto.FLOAT, taken)
    graph = helper.make_graph(nodes, f"denoise-{facts.kind}", [fed], outputs, held)
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="metamerlab"
    )
    model.ir_version = 8
    helper.set_model_props(model, {FACTS_KEY: as_json(facts)})
    return bytes(model.SerializeToString(deterministic=True))
