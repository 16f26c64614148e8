"""Shaders: includes, compile-time constants, and errors that name the file as written."""

import re
from importlib import resources

import numpy as np
import pytest

from pipeline.gl.compute import Shader
from pipeline.gl.context import create_context, release_context
from pipeline.gl.shader import ShaderError, ShaderSource, compile_source, flatten

HEAD = "#version 430\nlayout(local_size_x = 1) in;\n"
MAIN = "void main() {}\n"


@pytest.fixture
def shaders(tmp_path):
    """Give a function that writes shader files and returns their folder."""

    def write(**files):
        for name, text in files.items():
            folder = tmp_path / ("stage" if name == "main" else "shaderlib")
            folder.mkdir(exist_ok=True)
            (folder / f"{name}.{'comp.' if name == 'main' else ''}glsl").write_text(text)
        return tmp_path

    return write


def flat(root, **constants):
    return flatten("stage/main.comp.glsl", constants, root)


# --- Includes


def test_an_include_takes_its_place_and_keeps_its_origin(shaders):
    source = flat(
        shaders(main='#version 430\n#include "lib.glsl"\nvoid main() {}\n', lib="int a;\nint b;\n")
    )

    assert source.text == "#version 430\nint a;\nint b;\nvoid main() {}\n"
    assert source.origin == (
        ("stage/main.comp.glsl", 1),
        ("shaderlib/lib.glsl", 1),
        ("shaderlib/lib.glsl", 2),
        ("stage/main.comp.glsl", 3),
    )


@pytest.mark.parametrize(
    ("main", "one", "text"),
    [
        ((1, 2, 1), "int one;\n", "int one;\nint two;\n"),
        ((1,), '#include "two.glsl"\nint one;\n', "int two;\nint one;\n"),
    ],
)
def test_a_file_included_twice_or_by_one_that_it_includes_is_put_in_once(shaders, main, one, text):
    lines = {1: '#include "one.glsl"\n', 2: '#include "two.glsl"\n'}
    root = shaders(main="".join(map(lines.get, main)), one=one, two=lines[1] + "int two;\n")

    assert flat(root).text == text


def test_a_missing_include_is_named_with_the_line_that_wants_it(shaders):
    root = shaders(main='#include "lib.glsl"\n', lib='\n  #include "nowhere.glsl"\n')

    with pytest.raises(
        ShaderError, match=r"shaderlib/lib\.glsl:2: no shader file .*shaderlib/nowhere\.glsl"
    ):
        flat(root)


def test_a_missing_shader_is_named(gl_context):
    with pytest.raises(ShaderError, match=r"no shader file pipeline/pushpull/nowhere\.comp\.glsl"):
        Shader(gl_context, "pushpull/nowhere.comp.glsl")


def test_every_include_of_the_package_exists():
    package = resources.files("pipeline")
    stages = [folder for folder in package.iterdir() if folder.is_dir()]
    shader_files = [f for s in stages for f in s.iterdir() if f.name.endswith(".glsl")]
    wanted = {
        name for f in shader_files for name in re.findall(r'^#include "(.+)"', f.read_text(), re.M)
    }

    assert shader_files
    where = [name if "/" in name else f"shaderlib/{name}" for name in wanted]
    assert [name for name in where if not package.joinpath(name).is_file()] == []


# --- Constants


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (8, "8"),
        (-3, "(-3)"),
        (0.5, "0.5"),
        (1e-6, "1e-06"),
        (-0.25, "(-0.25)"),
        (True, "1"),
        (False, "0"),
        (np.float64(0.1), "0.1"),
        (np.float32(0.5), "0.5"),
        (np.int64(7), "7"),
        (np.bool_(True), "1"),
        ((0.5, -2.0), "float[](0.5, (-2.0))"),
    ],
)
def test_a_constant_becomes_a_define(shaders, value, text):
    source = flat(shaders(main="#constant SIZE  // px\nx = SIZE;\n"), SIZE=value)

    assert source.text == f"#define SIZE {text}\nx = SIZE;\n"


def test_a_constant_reaches_the_shader_with_its_value(gl_context, shaders):
    body = """
    #constant SCALE
    #constant OFFSET
    layout(std430, binding = 0) buffer Out { float result; };
    void main() { result = 3.0-OFFSET; result *= SCALE; }
    """
    buffer = gl_context.buffer(reserve=4)
    shader = compile_source(gl_context, flat(shaders(main=HEAD + body), SCALE=1e-3, OFFSET=-1))
    buffer.bind_to_storage_buffer(0)

    shader.run()
    gl_context.memory_barrier()
    result = np.frombuffer(buffer.read(), np.float32)
    shader.release()
    buffer.release()

    np.testing.assert_allclose(result, 4e-3, rtol=2.0**-22)


def test_a_constant_without_value_is_an_error(shaders):
    root = shaders(main="\n#constant TILE\nTILE\n")

    with pytest.raises(ShaderError, match=r"stage/main\.comp\.glsl:2: constant TILE has no value"):
        flat(root)


def test_an_unknown_constant_is_an_error(shaders):
    with pytest.raises(ShaderError, match="no '#constant TIEL'"):
        flat(shaders(main="#constant TILE\nTILE\n"), TILE=8, TIEL=8)


@pytest.mark.parametrize(
    "text",
    [
        "#constant TILE\nvoid main() {}\n",
        "#constant TILE  // TILE is the edge\n// TILE again\n/* and\nTILE */\n",
        "#constant TILE\nint TILES;\n",
        '#constant TILE\n#include "lib.glsl"\n',  # declared once more there
    ],
)
def test_a_constant_that_no_code_uses_is_an_error(shaders, text):
    root = shaders(main=text, lib="#constant TILE\n")

    with pytest.raises(ShaderError, match=r"glsl:1: constant TILE is never used"):
        flat(root, TILE=8)


def test_a_constant_may_be_declared_and_used_in_an_include(shaders):
    root = shaders(main='#include "lib.glsl"\n', lib="#constant TILE\nint a = TILE;\n")

    assert flat(root, TILE=8).text == "#define TILE 8\nint a = TILE;\n"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_constant_that_glsl_cannot_write_is_an_error(shaders, value):
    with pytest.raises(ShaderError, match="constant X must be finite"):
        flat(shaders(main="#constant X\nX\n"), X=value)


# --- Compile errors


@pytest.fixture
def private_context(shared_gl_context):  # noqa: ARG001  (skips without OpenGL)
    """Yield a context of its own: moderngl leaves a program behind when one is refused."""
    ctx = create_context()
    yield ctx
    release_context(ctx)


@pytest.mark.parametrize(
    ("main", "lib", "place"),
    [
        (f'{HEAD}#include "lib.glsl"\n{MAIN}', "int a;\n\nwrong b;\n", "shaderlib/lib.glsl:3"),
        (f'{HEAD}#include "lib.glsl"\n{MAIN}wrong b;\n', "int a;\n", "stage/main.comp.glsl:5"),
    ],
)
def test_a_compile_error_names_file_and_line_as_written(private_context, shaders, main, lib, place):
    source = flat(shaders(main=main, lib=lib))

    with pytest.raises(ShaderError) as caught:
        compile_source(private_context, source)

    message = str(caught.value)
    assert message.startswith("stage/main.comp.glsl does not compile:")
    assert re.search(rf"^(ERROR: )?{re.escape(place)}\b.*error", message, re.M | re.I), message


@pytest.mark.parametrize(
    ("log", "told"),
    [
        ("0:2(14): error: no such name", "lib:7: error: no such name"),  # Mesa
        ("0(2) : error C1008: undefined", "lib:7 : error C1008: undefined"),  # NVIDIA
        ("ERROR: 0:2: 'foo' : undeclared", "ERROR: lib:7: 'foo' : undeclared"),  # AMD, Intel
        ("0:1(1): error: a[0(2)] is 0:2", "main:1: error: a[0(2)] is 0:2"),  # prose stays
        ("0:99(1): error: past the end", "0:99(1): error: past the end"),
        ("error: linking failed", "error: linking failed"),
    ],
)
def test_every_drivers_way_to_give_a_line_is_understood(log, told):
    class Driver:
        def compute_shader(self, _text):
            import moderngl

            raise moderngl.Error(f"GLSL Compiler failed\n\n{log}\n")

    source = ShaderSource("one\ntwo\n", (("main", 1), ("lib", 7)))

    with pytest.raises(ShaderError) as caught:
        compile_source(Driver(), source)

    assert str(caught.value).splitlines()[3] == told


def test_a_failed_compile_keeps_the_drivers_words_as_its_cause(private_context, shaders):
    with pytest.raises(ShaderError, match="nosuchthing"):
        compile_source(
            private_context, flat(shaders(main=f"{HEAD}void main() {{ nosuchthing(); }}"))
        )
