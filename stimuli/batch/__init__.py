"""Build of a study's clips: plan, estimate, survey, frames, records, contact sheet, checks.

The modules in their order:

1. `sources` and `build_plan`: clips to make, each with the hash of all that decides its pixels.
2. `estimate`: clips, frames, disk and time of a plan.
3. `build` and `clip_build`: what is missing becomes jobs; `build` is that of warped clips,
   `clip_build` of anything. `batch_folder` says what lies where meanwhile.
4. `executors` and `jobs`: processes or a cluster, and what each does with its OpenGL context.
5. `footage` and `clip`: warped views with holes; survey of a path, frames of a clip.
6. `records` and `contact`: the manifest's entries, written last, and the contact sheet.
7. `check`: a finished batch hashed again. `export_holes`: warped frames for other programs.
"""
