"""Weighted pull-push on the GPU. Twin: reference.py."""

from pipeline.pushpull.gpu import PyramidPass


class WeightedPullPushPass(PyramidPass):
    """Pull-push with squared weights, as the note on hole filling has it."""

    down = "weighted_pullpush/reduce.comp.glsl"
    up = "weighted_pullpush/expand.comp.glsl"
