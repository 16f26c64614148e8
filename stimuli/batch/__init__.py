"""Build of a study's clips: plan, survey, frames, manifest, checks."""
