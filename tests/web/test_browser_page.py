"""The page that is shipped is the one that its sources make."""

import subprocess

from web_kernel import WEB, node_modules


def test_types_of_formats_are_what_the_published_schemas_give(tmp_path):
    node_modules()
    made = tmp_path / "formats.ts"
    subprocess.run(["node", "types.js", made], cwd=WEB, check=True, timeout=60)
    assert made.read_bytes() == (WEB / "src/kernel/formats.ts").read_bytes(), "npm run types"


def test_the_shipped_page_is_what_its_sources_make(tmp_path):
    node_modules()
    subprocess.run(["node", "build.js", tmp_path], cwd=WEB, check=True, timeout=120)
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    shipped = {path.name: path.read_bytes() for path in (WEB / "assets").iterdir()}
    assert sorted(made) == sorted(shipped)
    assert [name for name in made if made[name] != shipped[name]] == []
    for name in ("metamerlab.js", "metamerlab-jspsych.js"):
        text = made[name].decode()
        assert text.startswith("/* metamerlab (MIT). Contains\n@noble/hashes")
        assert "https://unpkg" not in text
