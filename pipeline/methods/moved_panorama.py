"""Panoramas with distance from another place: warped, with every hole filled by a method.

A view is flat, and warped as it is. The whole panorama, as a headset shows it, is put together of
its belt and the pictures of both poles: a mesh cannot surround a pole.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.foveation.geometry import (
    CapGeometry,
    EquirectangularGeometry,
    Geometry,
)
from pipeline.foveation.panorama import with_caps
from pipeline.foveation.view import SCORED_DEG, square_view
from pipeline.frame import PanoramaFrame, WarpedFrame
from pipeline.methods.registry import fill
from pipeline.warp.around import Outlook, seen_from
from pipeline.warp.gpu import warp_frame
from pipeline.warp.settings import WarpSettings


def warp_panorama(
    frame: PanoramaFrame,
    move_m: ArrayLike,
    geometry: Geometry | None = None,
    *,
    right_deg: float = 0.0,
    down_deg: float = 0.0,
    settings: WarpSettings = WarpSettings(),  # noqa: B008 (frozen)
    ctx: moderngl.Context | None = None,
) -> WarpedFrame:
    """Show what an eye sees that moved away from a panorama's middle, with holes.

    Parameters
    ----------
    move_m : three numbers
        Right, down, and towards the panorama's middle, metres.
    geometry : Geometry, optional
        Of the view: `Flat(...).of(width, height)`; by default square, 90 degrees wide, and as fine
        as the panorama.
    right_deg, down_deg : float
        Place of the view's middle: longitude and latitude from the panorama's middle.
    settings, ctx
        As `warp` has them.

    Raises
    ------
    InputError
        If the move is not three finite numbers.
    """
    geometry = geometry or square_view(frame.distance_m.shape[1], SCORED_DEG)
    return _warped(ctx, frame, Outlook.towards(geometry, move_m, right_deg, down_deg), settings)


def move_panorama(
    frame: PanoramaFrame,
    move_m: ArrayLike,
    method: str = "metameric",
    *,
    seed: int = 0,
    settings: WarpSettings = WarpSettings(),  # noqa: B008 (frozen)
    ctx: moderngl.Context | None = None,
    **parameters: Any,
) -> NDArray[np.float32]:
    """Show the whole panorama from another place, its holes filled.

    Parameters
    ----------
    move_m, settings, ctx
        As `warp_panorama` has them.
    method, seed, **parameters
        As `fill` has them.

    Returns
    -------
    ndarray of float32, shape (H, 2 H, 3)
        Encoded R'G'B'.

    Raises
    ------
    InputError
        As `warp_panorama` and `fill`.
    """
    height, width = frame.distance_m.shape
    belt = EquirectangularGeometry(width, height)
    margin = Outlook.towards(belt, move_m).margin_px

    def shown(geometry: CapGeometry | EquirectangularGeometry) -> NDArray[np.float32]:
        warped = _warped(ctx, frame, Outlook.towards(geometry, move_m), settings)
        return fill(warped, method, seed=seed, ctx=ctx, **parameters)

    whole = with_caps(shown(belt)[:, margin : margin + width], belt, shown)
    return whole.clip(0, 1).astype(np.float32)


def _warped(
    ctx: moderngl.Context | None, frame: PanoramaFrame, outlook: Outlook, settings: WarpSettings
) -> WarpedFrame:
    made = seen_from(frame, outlook)
    return warp_frame(
        made.source, made.flow_px, target_depth_m=made.target_depth_m, window=made.window,
        settings=settings, ctx=ctx,
    )  # fmt: skip
