"""A small network, built here, fills holes through ONNX Runtime."""

from contextlib import suppress

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.methods.onnx_files import open_session
from pipeline.methods.registry import create_method, method_files
from protocols.limits import LIMITS_VARIABLE

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
from onnx import TensorProto, helper, numpy_helper  # noqa: E402

FLOAT = TensorProto.FLOAT


def save(path, nodes, inputs, outputs, constants=()):
    values = [
        [helper.make_tensor_value_info(name, kind, shape) for name, kind, shape in group]
        for group in (inputs, outputs)
    ]
    graph = helper.make_graph(nodes, "net", *values, initializer=list(constants))
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, path)


IMAGE = ("image", FLOAT, [1, 3, "H", "W"])
MASK = ("mask", FLOAT, [1, 1, "H", "W"])
OUT = ("out", FLOAT, [1, 3, "H", "W"])


@pytest.fixture
def network(tmp_path):
    """Adds half the mask to the image: the fill is 0 + 0.5 in the network's range."""
    half = helper.make_tensor("half", FLOAT, [1], [0.5])
    nodes = [
        helper.make_node("Mul", ["mask", "half"], ["shift"]),
        helper.make_node("Add", ["image", "shift"], ["out"]),
    ]
    save(tmp_path / "net.onnx", nodes, [IMAGE, MASK], [OUT], [half])
    return tmp_path / "net.onnx"


@pytest.fixture
def frame(rng) -> WarpedFrame:
    hole = np.zeros((13, 22), bool)
    hole[4:9, 5:11] = True
    return WarpedFrame(
        rng.random((13, 22, 3), dtype=np.float32),
        np.ones((13, 22), np.float32),
        hole,
        np.zeros((13, 22, 2), np.float32),
    )


@pytest.mark.parametrize(("value_range", "shown"), [("0..1", 0.5), ("-1..1", 0.75)])
def test_a_network_fills_the_holes_and_nothing_else(network, frame, value_range, shown):
    """By hand: 0.5 in [-1, 1] is 0.75 in [0, 1]. Sizes are not multiples of 8."""
    method = create_method(f"onnx:{network}", None, {"value_range": value_range})
    filled = method.fill(frame, 0)

    np.testing.assert_allclose(filled[frame.hole], shown, atol=1e-6)
    np.testing.assert_array_equal(filled[~frame.hole], frame.colour[~frame.hole])
    np.testing.assert_array_equal(method.fill(frame, 0), filled)


def with_weights_beside(path, folder="w"):
    """Write a network whose weights lie in a file of their own, one of them in an inner graph."""
    weights = np.full(300, 0.5, np.float32)
    half = numpy_helper.from_array(weights, "half")
    inner = helper.make_graph(
        [helper.make_node("Identity", ["deep"], ["y"])],
        "inner",
        [],
        [helper.make_tensor_value_info("y", FLOAT, [300])],
        initializer=[numpy_helper.from_array(weights, "deep")],
    )
    nodes = [
        helper.make_node("Identity", ["image"], ["out"]),
        helper.make_node("If", ["yes"], ["z"], then_branch=inner, else_branch=inner),
    ]
    values = [[helper.make_tensor_value_info(*entry)] for entry in (IMAGE, OUT)]
    graph = helper.make_graph(nodes, "net", *values, initializer=[half])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    external = [model.graph.initializer[0]]
    external += [
        attribute.g.initializer[0] for node in model.graph.node for attribute in node.attribute
    ]
    (path.parent / folder).mkdir(exist_ok=True)
    names = []
    for number, tensor in enumerate(external):
        name = f"{folder}/{number}.bin"
        (path.parent / name).write_bytes(tensor.raw_data)
        tensor.ClearField("raw_data")
        tensor.data_location = TensorProto.EXTERNAL
        entry = tensor.external_data.add()
        entry.key, entry.value = "location", name
        names.append(name)
    path.write_bytes(model.SerializeToString())
    return names


def test_the_files_of_a_network_are_it_and_its_weights(tmp_path, network):
    names = with_weights_beside(tmp_path / "big.onnx")

    assert len(names) == 3
    assert method_files(f"onnx:{network}") == [network]
    assert method_files(f"onnx:{tmp_path / 'big.onnx'}") == [
        tmp_path / "big.onnx", *(tmp_path / name for name in sorted(names)),
    ]  # fmt: skip
    (tmp_path / names[1]).unlink()
    with pytest.raises(FileNotFoundError, match=names[1]):
        method_files(f"onnx:{tmp_path / 'big.onnx'}")


def test_a_network_larger_than_the_limit_is_refused_with_its_weights(tmp_path, monkeypatch):
    names = with_weights_beside(tmp_path / "big.onnx")
    sizes = [(tmp_path / name).stat().st_size for name in ("big.onnx", *names)]
    monkeypatch.setenv(LIMITS_VARIABLE, f"memory={sizes[0] - 1}")
    with pytest.raises(InputError, match="must have at most"):
        open_session(tmp_path / "big.onnx", "")
    monkeypatch.setenv(LIMITS_VARIABLE, f"memory={sum(sizes) - 1}")
    with pytest.raises(InputError, match="bytes with its weights"):
        open_session(tmp_path / "big.onnx", "")
    monkeypatch.setenv(LIMITS_VARIABLE, f"memory={sum(sizes)}")
    assert method_files(f"onnx:{tmp_path / 'big.onnx'}")


def test_a_network_does_not_reach_outside_its_folder(tmp_path):
    (tmp_path / "net").mkdir()
    with_weights_beside(tmp_path / "net" / "big.onnx", "../w")
    with pytest.raises(InputError, match="must name weights in its own folder"):
        method_files(f"onnx:{tmp_path / 'net' / 'big.onnx'}")


@pytest.mark.parametrize(
    "name", ["", ".", "w/\0", "link.bin", "circle.bin", "../net/../../etc/passwd"]
)
def test_weights_are_files_of_its_folder_when_they_are_listed_and_opened(tmp_path, name):
    (tmp_path / "net").mkdir()
    (tmp_path / "outside.bin").write_bytes(bytes(1200))
    (tmp_path / "net" / "link.bin").symlink_to(tmp_path / "outside.bin")
    (tmp_path / "net" / "circle.bin").symlink_to("circle.bin")
    path = tmp_path / "net" / "big.onnx"
    with_weights_beside(path)
    model = onnx.load(path, load_external_data=False)
    model.graph.initializer[0].external_data[0].value = name
    path.write_bytes(model.SerializeToString())

    for use in (method_files, create_method):
        with pytest.raises((InputError, FileNotFoundError), match=r"own folder|No such file"):
            use(f"onnx:{path}")


def test_a_network_with_any_byte_harmed_is_read_or_is_one_message(network, capfd):
    data = network.read_bytes()
    refused = 0
    for place in range(0, len(data), 2):
        network.write_bytes(data[:place] + b"\xf5" + data[place + 1 :])
        try:
            method_files(f"onnx:{network}")
            if place % 16 == 0:  # each starts a process
                create_method(f"onnx:{network}")
        except InputError:  # and nothing else
            refused += 1
    assert refused > 10
    assert capfd.readouterr().out == ""


def test_an_answer_that_is_no_picture_is_refused(tmp_path, frame):
    listed = helper.make_tensor_sequence_value_info("out", FLOAT, None)
    values = [helper.make_tensor_value_info(*entry) for entry in (IMAGE, MASK)]
    nodes = [helper.make_node("SequenceConstruct", ["image"], ["out"])]
    graph = helper.make_graph(nodes, "net", values, [listed])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, tmp_path / "list.onnx")
    whole = ("out", TensorProto.INT32, [1, 3, "H", "W"])
    nodes = [helper.make_node("Cast", ["image"], ["out"], to=TensorProto.INT32)]
    save(tmp_path / "whole.onnx", nodes, [IMAGE, MASK], [whole])

    for name in ("list", "whole"):
        with pytest.raises(InputError, match="output must"):
            create_method(f"onnx:{tmp_path / name}.onnx").fill(frame, 0)


def test_a_cut_network_is_refused_when_its_files_are_listed(network):
    data = network.read_bytes()
    for length in range(1, len(data)):
        network.write_bytes(data[:length])
        found = None
        with suppress(InputError):  # or it was cut between two fields
            found = method_files(f"onnx:{network}")
        assert found in (None, [network])
    network.write_bytes(b"\xff" * 100)
    with pytest.raises(InputError, match="must be an ONNX model"):
        method_files(f"onnx:{network}")


def test_the_files_of_a_folder_of_frames_are_all_that_lie_below_it(tmp_path):
    for name in ("0.png", "deep/0.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    assert method_files(f"frames:{tmp_path}") == [tmp_path / "0.png", tmp_path / "deep/0.png"]
    assert method_files("telea") == []


def test_a_network_that_passes_colours_through_gets_them_in_order(tmp_path, frame):
    """One input of 4 channels; the output is G, B, and the mask: zero, zero and one in holes."""
    index = helper.make_tensor("index", TensorProto.INT64, [3], [1, 2, 3])
    node = helper.make_node("Gather", ["planes", "index"], ["out"], axis=1)
    planes = ("planes", FLOAT, [1, 4, "H", "W"])
    save(tmp_path / "net.onnx", [node], [planes], [OUT], [index])

    filled = create_method(f"onnx:{tmp_path / 'net.onnx'}").fill(frame, 0)

    np.testing.assert_array_equal(
        filled[frame.hole], np.broadcast_to([0, 0, 1], (int(frame.hole.sum()), 3))
    )


def identity(path, inputs, out=OUT, node=None) -> str:
    save(path, [node or helper.make_node("Identity", [inputs[0][0]], ["out"])], inputs, [out])
    return f"onnx:{path}"


def test_networks_of_another_shape_are_refused(tmp_path):
    grey = ("image", FLOAT, [1, 1, "H", "W"])
    grey_out = ("out", FLOAT, [1, 1, "H", "W"])
    cases = {
        "grey": (
            [grey, MASK],
            ("out", FLOAT, [1, 1, "H", "W"]),
            "must take float32 image and mask",
        ),
        "one": ([IMAGE], OUT, "must take float32 image and mask"),
        "double": (
            [("image", TensorProto.DOUBLE, [1, 3, "H", "W"]), MASK],
            ("out", TensorProto.DOUBLE, [1, 3, "H", "W"]),
            "must take float32 image and mask",
        ),
        "mask out": ([MASK, IMAGE], grey_out, "first output must be"),
    }
    for name, (inputs, out, said) in cases.items():
        with pytest.raises(InputError, match=said):
            create_method(identity(tmp_path / f"{name}.onnx", inputs, out))


def test_a_network_of_fixed_size_says_so(tmp_path, frame):
    name = identity(
        tmp_path / "net.onnx",
        [("image", FLOAT, [1, 3, 16, 16]), ("mask", FLOAT, [1, 1, 16, 16])],
        ("out", FLOAT, [1, 3, 16, 16]),
    )

    with pytest.raises(InputError, match=r"takes images of 16 x 16 px only .* has 24 x 16"):
        create_method(name).fill(frame, 0)


def test_an_output_of_another_size_is_refused(tmp_path, frame):
    node = helper.make_node("AveragePool", ["image"], ["out"], kernel_shape=[2, 2], strides=[2, 2])
    name = identity(tmp_path / "net.onnx", [IMAGE, MASK], node=node)

    with pytest.raises(InputError, match="output must have shape"):
        create_method(name).fill(frame, 0)


def test_a_network_that_answers_nan_is_refused(tmp_path, frame):
    node = helper.make_node("Div", ["mask0", "mask0"], ["ratio"])
    zero = helper.make_tensor("zero", FLOAT, [1], [0.0])
    nodes = [
        helper.make_node("Mul", ["image", "zero"], ["mask0"]),
        node,
        helper.make_node("Identity", ["ratio"], ["out"]),
    ]
    save(tmp_path / "net.onnx", nodes, [IMAGE, MASK], [OUT], [zero])

    with pytest.raises(InputError, match="finite in every hole"):
        create_method(f"onnx:{tmp_path / 'net.onnx'}").fill(frame, 0)


def test_what_is_no_model_is_refused(tmp_path):
    (tmp_path / "bad.onnx").write_bytes(b"not a model")

    with pytest.raises(InputError, match=r"bad\.onnx: must be an ONNX model"):
        create_method(f"onnx:{tmp_path / 'bad.onnx'}")
    with pytest.raises(FileNotFoundError):
        create_method(f"onnx:{tmp_path / 'nowhere.onnx'}")


@pytest.mark.parametrize("parameters", [{"value_range": "0..255"}, {"multiple_px": 0}])
def test_parameters_out_of_range_are_refused(network, parameters):
    with pytest.raises(InputError, match=next(iter(parameters))):
        create_method(f"onnx:{network}", None, parameters)


def looping(path):
    """Write a network that counts to 2^62 before it answers."""
    info = [
        helper.make_tensor_value_info("i", TensorProto.INT64, []),
        helper.make_tensor_value_info("on", TensorProto.BOOL, []),
        helper.make_tensor_value_info("was", FLOAT, None),
        helper.make_tensor_value_info("still", TensorProto.BOOL, []),
        helper.make_tensor_value_info("is", FLOAT, None),
    ]
    body = [
        helper.make_node("Identity", ["on"], ["still"]),
        helper.make_node("Neg", ["was"], ["is"]),
    ]
    inner = helper.make_graph(body, "body", info[:3], info[3:])
    often = helper.make_tensor("often", TensorProto.INT64, [], [2**62])
    nodes = [helper.make_node("Loop", ["often", "", "image"], ["out"], body=inner)]
    save(path, nodes, [IMAGE, MASK], [OUT], [often])


def filling(path):
    """Write a network that adds 19 GB of zeros, whose count is in the file."""
    shape = helper.make_tensor("shape", TensorProto.INT64, [1], [4_800_000_000])
    nodes = [
        helper.make_node("ConstantOfShape", ["shape"], ["zeros"]),
        helper.make_node("ReduceSum", ["zeros"], ["zero"], keepdims=0),
        helper.make_node("Add", ["image", "zero"], ["out"]),
    ]
    save(path, nodes, [IMAGE, MASK], [OUT], [shape])


def widening(path):
    """Write a network that repeats its input a thousand times a thousand."""
    often = helper.make_tensor("often", TensorProto.INT64, [4], [1, 1, 1000, 1000])
    nodes = [
        helper.make_node("Tile", ["image", "often"], ["wide"]),
        helper.make_node("ReduceMax", ["wide"], ["most"]),
        helper.make_node("Add", ["image", "most"], ["out"]),
    ]
    save(path, nodes, [IMAGE, MASK], [OUT], [often])


@pytest.mark.parametrize(
    ("write", "name"),
    [(looping, "seconds"), (filling, "memory"), (widening, "memory")],
)
def test_a_network_takes_no_more_memory_or_time_than_a_picture_may(
    tmp_path, frame, monkeypatch, write, name
):
    monkeypatch.setenv(LIMITS_VARIABLE, "seconds=4" if name == "seconds" else "seconds=400")
    write(tmp_path / "net.onnx")
    with pytest.raises(InputError) as refused:
        create_method(f"onnx:{tmp_path / 'net.onnx'}").fill(frame, 0)
    said = str(refused.value)
    ours = f"raise the limit with {LIMITS_VARIABLE}={name}=" in said
    assert ours or (name == "memory" and "ONNX Runtime says" in said), said


def test_a_network_that_failed_once_is_refused_again_and_leaves_no_process(
    tmp_path, frame, monkeypatch
):
    monkeypatch.setenv(LIMITS_VARIABLE, "seconds=2")
    looping(tmp_path / "net.onnx")
    method = create_method(f"onnx:{tmp_path / 'net.onnx'}")
    for _ in range(2):
        with pytest.raises(InputError, match=r"net\.onnx: the network must"):
            method.fill(frame, 0)
    assert method._session._child.poll() is not None
