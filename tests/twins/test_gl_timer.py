"""GPU timing: what is run and recorded. How long things take is never a test's business."""

import pytest

from benchmarks.shared.clock import RunTimes, timed_runs


def test_work_is_run_for_warming_up_and_for_every_repeat(gl_context):
    runs = []

    timing = timed_runs(gl_context, lambda: runs.append(None), repeats=4, warm_up=2)

    assert len(runs) == 6
    assert len(timing.gpu_ms) == len(timing.wall_ms) == 4
    assert min(*timing.gpu_ms, *timing.wall_ms) >= 0


def test_a_mistake_in_the_work_is_not_swallowed(gl_context):
    def work():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        timed_runs(gl_context, work, repeats=1, warm_up=0)
    timed_runs(gl_context, lambda: None, repeats=1, warm_up=0)  # the clock is free again


@pytest.mark.parametrize(("gpu_ms", "median_ms"), [((3.0, 1.0, 2.0), 2), ((1e-6, 0.0, 1e-6), 20)])
def test_the_median_is_the_gpus_or_the_walls_where_the_gpus_clock_reads_nothing(gpu_ms, median_ms):
    assert RunTimes(gpu_ms=gpu_ms, wall_ms=(30.0, 10.0, 20.0)).median_ms == median_ms
