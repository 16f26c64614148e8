"""All benchmarks: `script/bench`, or `python -m benchmarks NAME --help`."""

import importlib
import sys

# name: what it measures. Each is a module of this folder, or of fits/, with `main(argv) -> status`.
BENCHMARKS = {
    "fill": "every fill method and the warp: time, memory, passes, ratio to push-pull",
    "gpu": "what a frame takes of the GPU, pass by pass, and of its host",
    "foveate": "foveated pictures: time, memory, passes, ratio to blur and copy",
    "live": "pictures that follow the gaze: CPU time, frames per second, latency, memory",
    "foveate_quality": "foveated pictures: band ratios, statistics, seeds, a moving gaze",
    "compress": "compressed pictures at equal size: statistics, fovea",
    "quality": "every fill method on stereo pairs: PSNR, SSIM, high frequencies, bands",
    "fit_kernels": "nothing: fits the kernels of the pyramid, and their errors",
    "fit_mixing": "nothing: fits how bands of noise are mixed, and its errors",
    "fit_overlap": "nothing: what bands find of the noise of textures",
    "pictures": "the pictures of README and docs, from our own scenes",
    "readme": "nothing: puts what was measured into the README",
    "stimuli": "frames per second of clips, two processes against one",
    "scores": "every built-in scene on three paths, by every metric of `stimuli score`",
    "session": "a whole simulated session",
    "analysis": "bootstraps, power and false positives of the statistics",
}


def main(argv: list[str]) -> int:
    """Run one benchmark; without a name, the fill."""
    name = argv[0] if argv and not argv[0].startswith("-") else None
    if name is None and ("--help" in argv or "-h" in argv):
        print("script/bench NAME [OPTIONS]; NAME --help says more\n")
        for known, what in BENCHMARKS.items():
            print(f"  {known:<16} {what}")
        return 0
    if name is not None and name not in BENCHMARKS:
        print(f"error: NAME must be one of {', '.join(BENCHMARKS)} (got {name!r})", file=sys.stderr)
        return 2
    folder = "fits." if name and name.startswith("fit_") else ""
    module = importlib.import_module(f"benchmarks.{folder}{name or 'fill'}")
    return int(module.main(argv[1:] if name else argv) or 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
