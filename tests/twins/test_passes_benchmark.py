"""The benchmark of passes: every dispatch of a call is timed, under its shader's name."""

from collections import Counter
from io import StringIO
from types import SimpleNamespace

import moderngl
import pytest
from rich.console import Console

from benchmarks import gpu
from benchmarks.fill import TimedFrame
from benchmarks.shared import dispatches
from benchmarks.shared.clock import Clock
from benchmarks.shared.dispatches import dispatches_of, timed_dispatches
from benchmarks.shared.frame_cost import frame_cost


@pytest.mark.parametrize("method", ["metameric", "push-pull"])
def test_every_dispatch_is_timed_once(gl_context, method):
    run = moderngl.ComputeShader.run
    bench = TimedFrame(gl_context, 64, "thin")
    work, _, release = bench.work(method)
    made = Counter(dispatches_of(work))

    clock = Clock(gl_context)
    cost = frame_cost(gl_context, work, repeats=2, clock=clock)

    release()
    clock.release()
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


def test_a_frame_whose_clock_changed_is_measured_again(gl_context, monkeypatch):
    clock = Clock(gl_context)
    monkeypatch.setattr(clock, "_software", False)
    monkeypatch.setattr(clock, "rise", lambda _work, _least_s: 1.0)
    probes = iter([1.0, 1.2, 1.0, 1.04, 9.0])
    monkeypatch.setattr(clock, "probe_ms", lambda: next(probes))

    cost = frame_cost(gl_context, clock.burst, repeats=1, clock=clock)

    assert cost.probes_ms == (1.0, 1.04)
    clock.release()


def test_a_card_is_kept_at_work_between_dispatches_and_that_is_not_counted(gl_context, monkeypatch):
    monkeypatch.setattr(dispatches, "describe", lambda _ctx: SimpleNamespace(software=False))
    clock, bench = Clock(gl_context), TimedFrame(gl_context, 64, "thin")
    work, _, release = bench.work("push-pull")
    bursts = 0

    def burst() -> None:
        nonlocal bursts
        bursts += 1
        clock.burst()

    with timed_dispatches(gl_context, burst) as found:
        work()

    assert [shader for shader, _ in found] == dispatches_of(work)
    assert bursts == len(found)
    for item in (clock, bench):
        item.release()
    release()


def test_a_row_at_another_clock_is_marked():
    row = {
        "bench": "fill", "name": "a", "edge_px": 64, "gpu_ms": 1.0, "frame_ms": 1.0,
        "host_ms": 1.0, "python_calls": 1, "to_copy": 1.0, "held_bytes": 0, "passes": [],
    }  # fmt: skip
    probed = {"probes_ms": [1.0, 1.01], "same_clock": True}
    rows = [row | probed, row | probed | {"probes_ms": [2.0, 2.0]}, row | {"name": "before 0.4"}]
    console = Console(width=gpu.WIDTH, file=StringIO())
    console.print(gpu.table(rows[:2]))
    console.print(gpu.table(rows[2:]))
    said = console.file.getvalue()

    assert "99 % " in said
    assert "50 %!" in said
    assert said.count("%") == 2
