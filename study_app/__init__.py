"""Gaze-fixation sessions, and the front door `metamerlab`.

`trial` is the state machine, `session` says what comes next, `presenter` is the window, `paint` the
same by numpy, `recorder` the journal.
"""
