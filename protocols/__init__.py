"""Formats that packages share: study, display, manifest, journal; shipped studies and displays.

`phases` is what a task says of a trial, in degrees; `script` the trial as every stage draws it, in
pixels; `plan` the order of trials. `blocks` has the blocks and the page of every file of HTML that
is written. Imports none of our other packages.
"""
