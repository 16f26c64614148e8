"""Contexts: which device is chosen, what is refused and how, and what is left behind."""

import ctypes
import gc
import os
import shutil
import subprocess
import sys

import moderngl
import pytest

from pipeline.errors import GLUnavailableError
from pipeline.gl.context import (
    REQUIRED_VERSION,
    adopt_context,
    create_context,
    describe,
    release_context,
)

CURE = "install a driver with OpenGL 4.3 or newer"


# --- Devices made up here


class FakeContext:
    def __init__(self, renderer, version_code):
        self.version_code = version_code
        self.info = {
            "GL_VENDOR": "Maker",
            "GL_RENDERER": renderer,
            "GL_VERSION": f"{version_code // 100}.{version_code // 10 % 10}",
        }
        self.released = False

    def release(self):
        self.released = True


@pytest.fixture
def devices(monkeypatch):
    """Give a function that puts EGL devices in place: (renderer, version) or a refusal.

    It returns the list of contexts opened since.
    """

    def plug_in(*found):
        opened = []

        def create(require, standalone, backend, device_index, **_libraries):
            assert standalone
            assert backend == "egl"
            if device_index >= len(found):
                raise Exception(
                    f"requested device index {device_index}, but found {len(found)} devices"
                )
            if isinstance(found[device_index], str):
                raise Exception(found[device_index])
            renderer, version_code = found[device_index]
            if version_code < require:
                raise Exception("eglCreateContext failed (0x3009)")
            opened.append(FakeContext(renderer, version_code))
            return opened[-1]

        monkeypatch.setattr(moderngl, "create_context", create)
        return opened

    return plug_in


LLVMPIPE = ("llvmpipe (LLVM 15.0.6, 256 bits)", 450)
GPU = ("NVIDIA RTX 4000/PCIe/SSE2", 460)


@pytest.mark.parametrize(
    ("found", "chosen"),
    [
        ([GPU, LLVMPIPE], GPU),
        ([LLVMPIPE, GPU], GPU),
        ([LLVMPIPE, "eglInitialize failed (0x3001)", GPU], GPU),
        ([("Old GPU", 330), LLVMPIPE], LLVMPIPE),
        ([("SwiftShader Device", 450), GPU], GPU),
        ([GPU, ("AMD Radeon", 460)], GPU),
        ([LLVMPIPE, ("softpipe", 430)], LLVMPIPE),
    ],
)
def test_the_first_hardware_renderer_is_chosen_else_the_first_in_software(devices, found, chosen):
    opened = devices(*found)

    renderer = describe(create_context())

    assert (renderer.name, renderer.version_code) == chosen
    assert [ctx.released for ctx in opened] == [True] * (len(opened) - 1) + [False]


def test_a_device_asked_for_is_taken_though_another_is_faster(devices):
    devices(GPU, LLVMPIPE)

    assert describe(create_context(1)).software


def test_too_old_drivers_are_refused_by_name_with_the_cure(devices):
    opened = devices(("Mesa Intel HD 3000", 330), ("Old NVIDIA", 420))

    with pytest.raises(GLUnavailableError) as caught:
        create_context()

    message = str(caught.value)
    assert message.startswith("OpenGL 4.3 through EGL is needed")
    assert "device 0: Mesa Intel HD 3000 (OpenGL 3.3)" in message
    assert "device 1: Old NVIDIA (OpenGL 4.2)" in message
    assert message.count(CURE) == 1
    assert all(ctx.released for ctx in opened)


def test_a_machine_without_devices_is_told_so(devices):
    devices()

    with pytest.raises(GLUnavailableError, match=rf"\(found: no EGL device\); {CURE}"):
        create_context()


def test_a_missing_library_is_told_once_and_not_for_every_device(devices):
    devices(*16 * ["libEGL.so not loaded"])

    with pytest.raises(GLUnavailableError) as caught:
        create_context()

    assert str(caught.value).count("libEGL.so not loaded") == 1


def test_a_device_that_is_not_there_is_told_with_the_number_of_those_that_are(devices):
    devices(GPU, LLVMPIPE)

    with pytest.raises(
        GLUnavailableError, match=r"EGL device 2 must .*but found 2 devices\); choose another"
    ):
        create_context(2)


def test_a_device_asked_for_that_is_too_old_is_refused_by_name(devices):
    devices(GPU, ("Old GPU", 420))

    with pytest.raises(
        GLUnavailableError, match=rf"EGL device 1 must .*Old GPU \(OpenGL 4.2\)\); {CURE}"
    ):
        create_context(1)


@pytest.mark.parametrize(
    ("version_code", "message"), [(320, r"found: Old GPU \(OpenGL 3.2\)"), (330, None)]
)
def test_a_windows_context_must_be_new_enough(monkeypatch, version_code, message):
    window = FakeContext("Old GPU", version_code)
    monkeypatch.setattr(moderngl, "init_context", lambda: None)
    monkeypatch.setattr(moderngl, "get_context", lambda: window)

    if message:
        with pytest.raises(GLUnavailableError, match=message):
            adopt_context()
    else:
        assert adopt_context() is window
    assert not window.released  # it is the window's


# --- The driver of this machine


@pytest.fixture
def egl(gl_context):  # noqa: ARG001  (skips without OpenGL, and is made current again after)
    """Give libEGL, to ask which context is current."""
    library = ctypes.CDLL("libEGL.so.1")
    library.eglGetCurrentContext.restype = ctypes.c_void_p
    return library


def test_the_renderer_is_described_as_the_driver_says(gl_context):
    renderer = describe(gl_context)

    assert renderer.name == gl_context.info["GL_RENDERER"]
    assert renderer.vendor == gl_context.info["GL_VENDOR"]
    assert renderer.version_code >= REQUIRED_VERSION
    assert str(renderer) == f"{renderer.name} (OpenGL {gl_context.info['GL_VERSION']})"


def test_a_new_context_is_current_and_a_released_one_is_not(egl):
    before = egl.eglGetCurrentContext()

    ctx = create_context()
    assert egl.eglGetCurrentContext() not in (None, before)

    release_context(ctx)
    assert egl.eglGetCurrentContext() is None


def test_the_current_context_can_be_adopted_and_survives_the_wrapper(egl, gl_context):
    current = egl.eglGetCurrentContext()

    adopted = adopt_context()
    assert describe(adopted) == describe(gl_context)
    adopted.release()

    assert egl.eglGetCurrentContext() == current
    texture = gl_context.texture((2, 2), 1)
    assert gl_context.error == "GL_NO_ERROR"
    texture.release()


def test_adopting_without_a_current_context_says_what_to_do(egl):
    egl.eglReleaseThread()

    with pytest.raises(GLUnavailableError, match="make the window's context current first"):
        adopt_context()


@pytest.mark.parametrize("version", ["4.2", "3.2"])
def test_mesa_told_to_be_old_is_refused_by_name(shared_gl_context, version):
    if "Mesa" not in describe(shared_gl_context).version:
        pytest.skip("only Mesa can be told its version")
    code = "from pipeline.gl.context import create_context; create_context()"

    done = subprocess.run(
        [sys.executable, "-P", "-c", code],
        env=os.environ | {"MESA_GL_VERSION_OVERRIDE": version},
        capture_output=True,
        text=True,
        check=False,
    )

    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1
    assert f"(OpenGL {version} " in last
    assert "Mesa" in last
    assert CURE in last


def test_a_driver_that_is_not_there_is_refused_with_the_cure(monkeypatch):
    monkeypatch.setenv("GLCONTEXT_LINUX_LIBEGL", "libNowhere.so")

    with pytest.raises(GLUnavailableError, match=rf"libNowhere\.so not loaded\); {CURE}"):
        create_context()


# --- A window

ADOPT = """
import glfw
from pipeline.gl.context import adopt_context, create_context, describe, release_context

glfw.init()
release_context(create_context())
for api in (glfw.NATIVE_CONTEXT_API, glfw.EGL_CONTEXT_API):
    glfw.default_window_hints()
    for hint, value in (
        (glfw.VISIBLE, False),
        (glfw.CONTEXT_CREATION_API, api),
        (glfw.CONTEXT_VERSION_MAJOR, 4),
        (glfw.CONTEXT_VERSION_MINOR, 3),
        (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE),
    ):
        glfw.window_hint(hint, value)
    window = glfw.create_window(64, 64, "", None, None)
    glfw.make_context_current(window)
    adopt_context().release()
    again = adopt_context()  # the window's context is still there
    again.texture((2, 2), 4)
    print("adopted", describe(again).version_code >= 430, again.error)
    glfw.destroy_window(window)
"""


def test_a_windows_context_is_adopted_by_glx_and_by_egl_after_an_off_screen_one():
    if shutil.which("xvfb-run") is None:
        if os.environ.get("REQUIRE_GL") == "1":
            pytest.fail("xvfb-run is needed (apt-get install xvfb xauth)")
        pytest.skip("xvfb-run is not installed (apt-get install xvfb xauth)")

    done = subprocess.run(
        ["xvfb-run", "-a", sys.executable, "-P", "-c", ADOPT],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )

    assert done.stdout.splitlines() == 2 * ["adopted True GL_NO_ERROR"], done.stderr


# --- The fixture that every test of the GPU stands on


def test_objects_left_alive_are_seen_although_python_has_forgotten_them(gl_watch):
    ctx = create_context()  # goes at the end, with all that is left in it
    watch = gl_watch()
    things = [
        ctx.texture((2, 2), 1),
        ctx.buffer(reserve=4),
        ctx.compute_shader("#version 430\nlayout(local_size_x=1) in; void main() {}"),
    ]
    things[-1].run()  # a bound program is freed only when the next one is bound
    assert {name.split()[0] for name in watch.gained()} == {"texture", "buffer", "program"}

    for thing in things:
        thing.release()
    assert not watch.gained()

    forgotten = ctx.texture((2, 2), 1)
    name = f"texture {forgotten.glo}"
    del forgotten
    gc.collect()
    assert watch.gained() == {name}
    assert not gl_watch().gained()  # what was there before is not new
    release_context(ctx)
