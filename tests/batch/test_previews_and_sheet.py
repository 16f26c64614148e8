"""Previews before a study: a video of each clip, and one page of all of them."""

import json
import re
import resource
import shutil
import subprocess

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from protocols.manifest import read_manifest
from stimuli.batch.build import build
from stimuli.batch.contact import SHOWN_FRAMES, TILE_PX
from stimuli.media.png import decode_png
from stimuli.media.video import LARGEST_PX, preview_path, write_preview

BEFORE = """<script>
window.problems = [];
addEventListener("error", event => problems.push(String(event.message)), true);
addEventListener("unhandledrejection", event => problems.push(String(event.reason)));
for (const kind of ["error", "warn"]) console[kind] = (...what) => problems.push(what.join(" "));
</script>"""
AFTER = """<script>
const mean = canvas => {
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const sum = [0, 0, 0];
  for (let k = 0; k < data.length; k += 4) for (let c = 0; c < 3; ++c) sum[c] += data[k + c];
  return sum.map(value => value / (data.length / 4));
};
const small = () => [...document.querySelectorAll("canvas[data-clip]")].map(mean);
const big = () => ["leftview", "rightview"].map(id => mean(document.getElementById(id)));
function look() {
  if (document.body.dataset.ready !== "yes") { setTimeout(look, 20); return; }
  const slider = document.getElementById("frame"), report = {};
  report.first = { small: small(), big: big(), says: which.textContent };
  slider.value = slider.max;
  slider.dispatchEvent(new Event("input"));
  report.last = { small: small(), big: big(), says: which.textContent };
  const left = document.getElementById("left");
  left.value = "3";
  left.dispatchEvent(new Event("change"));
  report.chosen = big();
  document.querySelectorAll("canvas[data-clip]")[2].click();
  report.clicked = big();
  report.natural = images.map(image => [image.naturalWidth, image.naturalHeight]);
  report.loaded = performance.getEntriesByType("resource").map(entry => entry.name.slice(0, 40));
  report.problems = problems;
  document.body.dataset.report = btoa(JSON.stringify(report));
}
look();
</script>"""


@pytest.fixture(scope="module")
def report(batch, tmp_path_factory):
    """Open the sheet in a browser, use it, and return what it showed."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("needs Chromium (apt-get install chromium)")
    folder = tmp_path_factory.mktemp("browser")
    text = (batch / "contact-sheet.html").read_text(encoding="utf-8")
    assert text.count("<head>") == text.count("</body>") == 1
    text = text.replace("<head>", "<head>" + BEFORE).replace("</body>", AFTER + "</body>")
    page = folder / "page.html"
    page.write_text(text, encoding="utf-8")
    result = subprocess.run(
        [browser, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000",
         f"--user-data-dir={folder}/profile", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=180,
    )  # fmt: skip
    found = re.search(r'data-report="([^"]+)"', result.stdout)
    assert found, result.stdout[-2000:]
    import base64

    return json.loads(base64.b64decode(found[1]))


def means(batch, index):
    """Mean colour of frame `index` of every clip, 0 to 255."""
    clips = read_manifest(batch).clips
    return [decode_png(batch / clip.frame_path(index)).mean(axis=(0, 1)) for clip in clips]


@pytest.mark.slow
def test_every_thumbnail_shows_its_clip(report, batch):
    """Means survive a JPEG to about one level."""
    for frame, key in ((0, "first"), (3, "last")):
        np.testing.assert_allclose(report[key]["small"], means(batch, frame), atol=1.5)
    assert np.ptp(means(batch, 0), axis=0).max() > 10  # clips can be told apart by it


def test_the_slider_and_the_choices_change_the_pictures(report, batch):
    first, last = means(batch, 0), means(batch, 3)
    moved = np.abs(np.asarray(report["first"]["small"]) - report["last"]["small"]).max(axis=1)
    assert (moved > 0.01).all()
    np.testing.assert_allclose(report["first"]["big"], first[:2], atol=1.5)
    np.testing.assert_allclose(report["last"]["big"], last[:2], atol=1.5)
    np.testing.assert_allclose(report["chosen"], [last[3], last[1]], atol=1.5)
    np.testing.assert_allclose(report["clicked"], [last[3], last[2]], atol=1.5)
    assert report["first"]["says"] == "frame 0 (0.00 s)"
    assert report["last"]["says"] == "frame 3 (0.30 s)"


def test_the_page_needs_nothing_else_and_complains_of_nothing(report, batch):
    assert report["problems"] == []
    assert all(name.startswith("data:") for name in report["loaded"])
    text = (batch / "contact-sheet.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href|url)\s*[=(]\s*[\"']?(?!data:|#)", text.split("<script>")[0])
    assert not re.search(r"https?://", text)
    clips = read_manifest(batch).clips
    tile = min(TILE_PX, clips[0].width_px)
    height = min(SHOWN_FRAMES, 4) * clips[0].height_px
    assert report["natural"] == [[tile, height]] * len(clips)


def frames_of(path):
    video = cv2.VideoCapture(str(path))
    frames, rate = [], video.get(cv2.CAP_PROP_FPS)
    while True:
        there, frame = video.read()
        if not there:
            video.release()
            return frames, rate
        frames.append(frame[..., ::-1])


def distance(frame, other):
    return float(np.sqrt(np.mean((frame.astype(float) - other) ** 2)))


def test_previews_play_every_frame_as_it_is(batch):
    """Each decoded frame is nearest to its own clip's frame of that number."""
    clips = read_manifest(batch).clips
    assert len(list((batch / "previews").iterdir())) == len(clips)
    for clip in clips:
        frames, rate = frames_of(preview_path(batch, clip))
        assert len(frames) == len(clip.frames_sha256)
        assert rate == pytest.approx(clip.fps)
        for index, frame in enumerate(frames):
            assert frame.shape == (clip.height_px, clip.width_px, 3)
            others = [
                distance(frame, decode_png(batch / clip.frame_path(k))) for k in range(len(frames))
            ]
            assert int(np.argmin(others)) == index
            assert others[index] < 40  # of 255: small, noisy and compressed; black is 100 away


def test_a_large_clips_preview_is_small_and_a_deep_ones_is_right(batch, tmp_path):
    (clip,) = read_manifest(batch).clips[:1]
    big = clip.model_copy(update={"width_px": 700, "height_px": 351, "bit_depth": 16})
    folder = tmp_path / big.name
    folder.mkdir()
    ramp = np.tile(np.linspace(0, 65535, 700, dtype=np.uint16)[None, :, None], (351, 1, 3))
    for index in range(4):
        cv2.imwrite(str(folder / f"{index:06d}.png"), ramp)
    write_preview(tmp_path, big, tmp_path / "a.webm")
    frames, _ = frames_of(tmp_path / "a.webm")
    assert len(frames) == 4
    assert frames[0].shape == (240, LARGEST_PX, 3)
    np.testing.assert_allclose(frames[0][120, ::40, 1], np.linspace(0, 255, 480)[::40], atol=6)
    assert [path.name for path in tmp_path.iterdir() if "part" in path.name] == []


def test_a_preview_that_was_deleted_is_made_again(batch, small_study, read_plan, inline):
    clip = read_manifest(batch).clips[0]
    path = preview_path(batch, clip)
    before = frames_of(path)[0]
    path.unlink()
    left_over = path.with_name(f".{path.stem}.4711.part.webm")  # of a build that was killed
    left_over.write_bytes(b"half")
    outcome = build(read_plan(small_study), batch, inline)
    assert outcome.built == []
    np.testing.assert_array_equal(frames_of(path)[0], before)
    assert not left_over.exists()


def test_the_same_frames_give_the_same_bytes_of_a_preview(batch, tmp_path):
    clip = read_manifest(batch).clips[0]
    written = []
    for name in ("a.webm", "b.webm"):
        write_preview(batch, clip, tmp_path / name)
        written.append((tmp_path / name).read_bytes())
    assert written[0] == written[1]
    assert len(frames_of(tmp_path / "a.webm")[0]) == len(clip.frames_sha256)


def test_a_preview_on_a_full_disk_is_not_kept(batch, tmp_path):
    clip = read_manifest(batch).clips[0]
    write_preview(batch, clip, tmp_path / "a.webm")
    limit, size = resource.getrlimit(resource.RLIMIT_FSIZE), (tmp_path / "a.webm").stat().st_size
    for short in (size // 2, size - 1):
        resource.setrlimit(resource.RLIMIT_FSIZE, (short, limit[1]))
        try:
            with pytest.raises(InputError, match=r"b\.webm: cannot be written"):
                write_preview(batch, clip, tmp_path / "b.webm")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert [path.name for path in tmp_path.iterdir()] == ["a.webm"]
