"""Dependence of a clip's hash: on its own sources, and no others."""

import ast
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Lock

import stimuli.batch.sources
from pipeline.methods.registry import check_method_name
from stimuli.batch.sources import source_files, source_sha256


def files_of(method: str) -> set[str]:
    return set(source_files(check_method_name(method).target.partition(":")[0]))


def test_a_methods_files_are_those_it_imports_with_their_shaders():
    metameric, pushpull = files_of("metameric"), files_of("push-pull")
    assert any("pipeline.synthesis" in name for name in metameric)
    assert any(name.endswith(".glsl") for name in metameric)
    assert not any("synthesis" in name or "features" in name for name in files_of("telea"))
    assert any("pushpull" in name and name.endswith(".glsl") for name in pushpull)


def test_a_scenes_files_leave_other_scenes_out():
    garden = set(source_files("stimuli.scenes.garden"))
    assert "stimuli.scenes.shapes.py" in garden
    assert not any("castle" in name for name in garden)


def test_the_base_leaves_methods_and_protocols_out():
    from stimuli.rendering.open_scene import BASE_MODULES

    base = set(source_files(*BASE_MODULES))
    assert any("pipeline.warp.gpu" in name for name in base)
    assert not any("synthesis" in name or "telea" in name for name in base)
    assert not any(name.startswith("protocols") for name in base)


def test_one_changed_byte_changes_the_hash(tmp_path, monkeypatch):
    before = source_sha256("pipeline.methods.opencv")
    original = stimuli.batch.sources.source_files

    def changed(*modules: str):
        files = original(*modules)
        name = next(iter(files))
        copy = tmp_path / "copy.py"
        copy.write_bytes(files[name].read_bytes() + b"\n")
        return files | {name: copy}

    monkeypatch.setattr(stimuli.batch.sources, "source_files", changed)
    assert source_sha256("pipeline.methods.opencv") != before


def test_one_thread_parses_at_a_time(monkeypatch):
    """Stimuli are hashed in threads, and Python before 3.11.8 refuses two trees made at once."""
    parse, parsing, alone = ast.parse, Lock(), []

    def slow(text: str) -> ast.Module:
        alone.append(parsing.acquire(blocking=False))
        time.sleep(0.005)
        if alone[-1]:
            parsing.release()
        return parse(text)

    stimuli.batch.sources._imports.cache_clear()
    with monkeypatch.context() as patch, ThreadPoolExecutor(4) as pool:
        patch.setattr(ast, "parse", slow)
        hashes = set(pool.map(source_sha256, ["pipeline.methods.opencv"] * 4))

    assert len(hashes) == 1
    assert len(alone) > 1
    assert all(alone)
