"""A study in a headset that is made up: whole sessions come home, and faults are said."""

import base64
import io
import json
import math

import numpy as np
import pytest
from PIL import Image
from web_browser import begin, iwer, said, served, until, whole
from web_study import brought_home, built, changed, for_browsers

from protocols.browser.head_poses import encoded_poses, poses_of
from protocols.journal import Note
from protocols.journal_file import read_journal
from protocols.script import Frames
from protocols.study_file.session_schema import Headset
from study_app.paint import bitmaps_of, paint
from study_app.session_folders import find_sessions
from study_app.verification import verify
from study_app.web.export import WebBuild
from study_app.web.eye_views import directions, eye_view
from study_app.web.import_lines import DISTURBANCES

TURN_DEG = 12.0


@pytest.fixture(scope="module")
def of(case, tmp_path_factory):
    """A built study for headsets."""
    study = for_browsers(case("yes-no").study, tolerance_s=0.01, headset=Headset(turn_deg=TURN_DEG))
    return built(study, tmp_path_factory.mktemp("headset"))


@pytest.fixture(scope="module")
def lines(chromium, of):
    """The lines of a session in a headset."""
    with served(of.out) as site:
        whole(chromium, site, *iwer("oculusQuest1", 72))
    return [*dict.fromkeys(site.lines)]


def home(of, site, root):
    """Bring home one whole session, to which Python agrees; return its journal."""
    (imported,) = brought_home(of, site.lines, root)
    assert (imported.state, imported.reason) == ("imported", "completed"), imported.message
    (session,) = find_sessions(root)
    assert list(verify(session, of.study).problems) == []
    return read_journal(root / of.study.study.name / imported.participant / "journal.jsonl")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "hz"),
    [("oculusQuest1", 72), ("metaQuest2", 72), ("metaQuestPro", 72), ("metaQuest3", 72)],
)
def test_an_undisturbed_session_in_a_headset_comes_home(chromium, of, tmp_path, kind, hz):
    with served(of.out) as site:
        whole(chromium, site, *iwer(kind, hz))
        assert chromium.errors == []
        assert site.ended == {"done": True}
        assert chromium.evaluate("headset.pages")[:2] == ["test", "consent"]
    journal = home(of, site, tmp_path)
    assert {one.void_reason for one in journal.attempts} == {None}
    machine = journal.start.remote.machine
    assert machine.headset.profile.startswith(("oculus-touch", "meta-quest-touch"))
    assert [view.eye for view in machine.headset.views] == ["left", "right"]
    assert machine.headset.eye_distance_m == pytest.approx(0.063, abs=0.001)
    assert journal.start.refresh_hz == hz
    for one in journal.attempts:
        assert one.head_turn_deg < 0.1
        poses = (journal.path.parent / one.poses_file.file).read_text().splitlines()
        flips = (journal.path.parent / one.flips_file.file).read_text().splitlines()
        assert len(poses) >= len(flips)
        assert poses[1].startswith("0,0,0,0,32767,0.00")


FAULTS = """
const { device } = headset;
const turned = (deg) => [0, Math.sin(deg * Math.PI / 360), 0, Math.cos(deg * Math.PI / 360)];
const posed = XRFrame.prototype.getViewerPose;
let blind = false;
XRFrame.prototype.getViewerPose = function (space) {
  return blind ? undefined : posed.call(this, space);
};
headset.each = (phase, attempts) => {
  device.quaternion.set(...turned(0));
  if (device.visibilityState !== "visible") device.updateVisibilityState("visible");
  if (phase === "iti") device.controllers.left.connected = true;
  blind = false;
  if (phase !== "stimulus") return;
  if (attempts === 1) device.quaternion.set(...turned(15));
  if (attempts === 2) device.updateVisibilityState("visible-blurred");
  if (attempts === 3) for (let n = 1; n <= 5; n++) clock.drop.add(clock.frame + n);
  if (attempts === 4) void device.activeSession.end();
  if (attempts === 5) device.controllers.left.connected = false;
  if (attempts === 6) headset.press("right", "squeeze");
  if (attempts === 7) blind = true;
  if (attempts === 8) device.quaternion.set(...turned(11));
};
"""
HEADSET_FAULTS = ["turned", "hidden", "session-end", "controller-lost", "head-lost"]


@pytest.mark.slow
def test_whatever_comes_between_in_a_headset_voids_the_attempt_and_is_named(chromium, of, tmp_path):
    with served(of.out) as site:
        whole(chromium, site, *iwer("metaQuest3", 72), FAULTS)
        assert chromium.errors == []
    lines = said(site.lines, "attempt")
    assert [line["disturbed"][1] for line in lines if line["disturbed"]] == HEADSET_FAULTS
    assert [line["void_reason"] for line in lines[:9]] == [
        "focus-lost", "focus-lost", "dropped-frames", "focus-lost", "focus-lost", "paused",
        "focus-lost", None, None,
    ]  # fmt: skip
    assert len(said(site.lines, "pause")) == 6
    journal = home(of, site, tmp_path)
    notes = [event.text for event in journal.events if isinstance(event, Note)]
    assert notes == [DISTURBANCES[what] for what in HEADSET_FAULTS]
    turns = [one.head_turn_deg for one in journal.attempts]
    assert turns[0] == pytest.approx(15, abs=0.02)
    assert turns[7] == pytest.approx(11, abs=0.02)
    done = [one.trial for one in journal.attempts if one.outcome == "completed"]
    assert len(done) == len(set(done)) == len({one.trial for one in journal.attempts})


@pytest.mark.slow
def test_a_killed_tab_of_a_headset_goes_on_at_the_same_trial(chromium, of, tmp_path):
    with served(of.out) as site:
        begin(chromium, site, *iwer("oculusQuest1", 72))
        until(chromium, "headset.pages.includes('break')")
        chromium.close(crash=True)
        whole(chromium, site, *iwer("oculusQuest1", 72))
    journal = home(of, site, tmp_path)
    done = [one.trial for one in journal.attempts if one.outcome == "completed"]
    assert len(done) == len(set(done))
    assert len(said(site.lines, "resume")) == 1


@pytest.mark.slow
def test_who_leaves_in_a_headset_or_has_none_is_told(chromium, of):
    with served(of.out) as site:
        begin(chromium, site, *iwer("oculusQuest1", 72), 'headset.leaves = ["start", "quit"];')
        until(chromium, "document.querySelector('main button.withdraw')")
        assert chromium.text().startswith("You have left the study.")
        assert said(site.lines, "end")[-1]["reason"] == "quit"
        begin(chromium, site)
        until(chromium, "document.querySelector('main')?.dataset.page === 'over'")
        assert chromium.text().startswith("This study needs a headset with two controllers.")
        begin(chromium, site, *iwer("oculusQuest1", 60), "observer.reads_ms = 1e9;")
        until(chromium, "document.querySelector('main')?.dataset.page === 'gate'")
        assert "Set their distance to that of your eyes." in chromium.text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"poses": None}, "poses must be given of a headset, and only of one"),
        ({"poses": "AAAA"}, "poses must be Base64 of whole poses"),
        ({"poses": "AAAAAAAA/38="}, "poses must be"),
        (
            lambda line: {
                "poses": encoded_poses(
                    poses_of(np.tile([0.0, 0.5, 0, 0.75**0.5], (len(line["flips_us"]), 1)))
                )
            },
            "that is turned by 60.0 deg must void the attempt",
        ),
        (
            {"disturbed": [1, "turned"], "void_reason": "focus-lost", "outcome": "void"},
            "deg at flip 1",
        ),
    ],
)
def test_lines_that_contradict_their_poses_are_refused(of, lines, tmp_path, fields, words):
    found, number = changed(lines, "attempt", fields)
    (told,) = brought_home(of, found, tmp_path)
    assert told.state == "refused"
    assert f"line number {number}" in told.message
    assert words in told.message


TURN = [0.02, 0.06, 0.03]
GRAB = """
headset.device.quaternion.set(...TURN);
const posed = XRFrame.prototype.getViewerPose;
let views = [];
XRFrame.prototype.getViewerPose = function (space) {
  const seen = posed.call(this, space);
  for (const view of seen?.views ?? []) {
    const aside = view.eye === "left" ? -0.15 : 0.15; // as lenses that point outward have
    const projectionMatrix = view.projectionMatrix.map((value, index) =>
      index === 8 ? aside : index === 9 ? 0.1 : index === 0 || index === 5 ? 4 : value);
    Object.defineProperty(view, "projectionMatrix", { value: projectionMatrix });
  }
  views = seen?.views ?? [];
  return seen;
};
const grabbed = (window.grabbed = {});
const large = (canvas_px) => {
  const [width, height] = (headset.canvas_px = canvas_px);
  Object.assign(document.querySelector("canvas"), { width, height });
};
headset.each = (phase, attempts) => {
  if (phase === "fixate" && attempts === 2) large([1024, 512]);
  if (phase === "fixate" && attempts === 3) large([128, 64]);
};
headset.stays = (phase, attempts) => {
  if (attempts !== 2 || phase in grabbed) return;
  const turns = views.map(({ transform }) => [...transform.matrix]);
  grabbed[phase] = [document.querySelector("canvas").toDataURL("image/png"), turns];
};
"""


def grabbed(chromium, of):
    """Yield each phase of a trial by its name, with what an eye saw of it, and its directions."""
    unit = [*TURN, math.sqrt(1 - sum(part**2 for part in TURN))]
    with served(of.out) as site:
        begin(chromium, site, *iwer("metaQuest3", 72), GRAB.replace("TURN", json.dumps(unit)))
        until(chromium, "grabbed.respond")
        found = chromium.evaluate("grabbed")
        chromium.close()
    for phase, (url, turns) in found.items():
        pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))))[
            ..., :3
        ]
        for eye, matrix in enumerate(turns):
            aside = (-0.15, 0.15)[eye]
            tangents = ((aside - 1) / 4, (aside + 1) / 4, -0.9 / 4, 1.1 / 4)
            turn = np.array(matrix).reshape(4, 4).T[:3, :3]
            yield phase, pixels[:, 512 * eye :][:, :512], directions((512, 512), tangents, turn)


def shown_in(of, name, around):
    """Yield the screens and panoramas that a phase may show, with each stimulus of the study."""
    build = WebBuild(of.study, of.display, of.manifest)
    script = next(build._all_scripts())
    phase = next(one for one in script.phases if one.name == name)
    width, height = of.exported["window_px"]
    shows = any(isinstance(entry, Frames) for entry in phase.show)
    for clip in of.manifest.clips:
        pixels = np.asarray(Image.open(of.stimuli / clip.frame_path(0)).convert("RGB"))
        if around:  # all else is on a flat screen before it
            phase = phase.model_copy(
                update={"show": tuple(one for one in phase.show if not isinstance(one, Frames))}
            )
        screen = paint(script, phase, {0: [pixels]}, bitmaps_of(build.shown, of.display))
        top, left = screen.shape[0] // 2 - height // 2, screen.shape[1] // 2 - width // 2
        part = screen[top : top + height, left : left + width]
        if around and shows:
            before = (part != script.background).any(axis=-1, keepdims=True)
            yield np.dstack([part, np.where(before, 255, 0)]).astype(np.uint8), pixels
        else:
            yield part, None


@pytest.mark.slow
@pytest.mark.parametrize("around", [False, True])
def test_both_eyes_see_what_the_definition_says_with_the_head_turned(
    chromium, case, tmp_path, around
):
    study = case("yes-no").study
    size = {"width_px": 256, "height_px": 128} if around else {}
    study = study.model_copy(update={"stimuli": study.stimuli.model_copy(update=size)})
    headset = Headset(around=around)
    of = built(for_browsers(study, tolerance_s=0.01, headset=headset), tmp_path)
    distance_px, background = of.exported["headset"]["distance_px"], of.exported["background"]
    seen = set()
    for phase, pixels, rays in grabbed(chromium, of):
        off = [
            abs(eye_view(rays, screen, distance_px, background, panorama) - pixels).max()
            for screen, panorama in shown_in(of, phase, around)
        ]
        assert min(off) <= 1, (phase, min(off))
        assert len(np.unique(pixels)) > 1 or phase == "iti", phase
        seen.add(phase)
    assert seen >= {"fixate", "stimulus", "respond"}
