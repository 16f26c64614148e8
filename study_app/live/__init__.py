"""Pictures that follow the gaze: the loop, its latency, and its log, which can be drawn again.

`in_trials` is the same in trials. Pictures come from a `LiveRenderer`, which
`study_app.cli.pictures.live_renderer` fills.
"""
