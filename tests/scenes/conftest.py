"""OpenEXR files as other programs lay them out."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest


def _write_exr(path, parts):
    """Write parts, each {channel: plane}, half where a plane is float16."""
    specs = []
    for number, part in enumerate(parts):
        height, width = next(iter(part.values())).shape
        spec = oiio.ImageSpec(width, height, len(part), "float")
        spec.channelnames = tuple(part)
        spec.channelformats = tuple(
            "half" if plane.dtype == np.float16 else "float" for plane in part.values()
        )
        spec.attribute("oiio:subimagename", f"part{number}")
        specs.append(spec)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), tuple(specs)) if len(specs) > 1 else out.open(str(path), specs[0])
    for number, part in enumerate(parts):
        if number:
            assert out.open(str(path), specs[number], "AppendSubimage")
        data = np.stack([plane.astype(np.float32) for plane in part.values()], -1)
        assert out.write_image(np.ascontiguousarray(data))
    out.close()


@pytest.fixture
def write_exr():
    """Give the function that writes parts, each {channel: plane}, half where one is float16."""
    return _write_exr
