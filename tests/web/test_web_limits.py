"""Large studies, pictures with colours of their own, and times at other rates, as exports see them."""

from __future__ import annotations

from protocols.web_study import Pack, WebPhase


def test_packs_and_times_may_be_as_large_as_budgets_allow():
    sha = "0" * 64
    assert Pack(file="a.pack", bytes=300_000_000, sha256=(sha,), ends=(300_000_000,)).bytes > 1e6
    hours = 3 * 3600 * 240
    phase = WebPhase(
        name="answer", frames=None, show=(), gate_frames=None, watched=False, question=None,
        timeout_frames=hours, follows={},
    )  # fmt: skip
    assert phase.timeout_frames == hours
