"""The benchmark of passes: every dispatch of a call is timed, under its shader's name."""

from collections import Counter

import moderngl
import pytest

from benchmarks.fill import TimedFrame
from benchmarks.shared.dispatches import dispatches_of, timed_dispatches
from benchmarks.shared.frame_cost import frame_cost


@pytest.mark.parametrize("method", ["metameric", "push-pull"])
def test_every_dispatch_is_timed_once(gl_context, method):
    run = moderngl.ComputeShader.run
    bench = TimedFrame(gl_context, 64, "thin")
    work, _, release = bench.work(method)
    made = Counter(dispatches_of(work))

    cost = frame_cost(gl_context, work, repeats=2)

    release()
    bench.release()
    passes = cost.passes
    assert {item.shader: item.dispatches for item in passes} == made
    assert len(passes) == len(made)
    names = [item.shader for item in passes]
    assert all(name.endswith(".comp.glsl") for name in names)
    assert all(item.least_ms > 0 for item in passes)
    assert cost.dispatches == made.total()
    assert cost.gpu_ms == sum(item.least_ms for item in passes)
    assert cost.frame_ms > cost.host_ms > 0
    assert moderngl.ComputeShader.run is run


def test_what_goes_wrong_inside_leaves_no_clock_behind(gl_context):
    run = moderngl.ComputeShader.run

    with pytest.raises(ZeroDivisionError), timed_dispatches(gl_context):
        _ = 1 / 0

    assert moderngl.ComputeShader.run is run
