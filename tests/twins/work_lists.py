"""Work lists of the last frame, read back."""

import numpy as np

from pipeline.gl.compute import Shader


def read_numbers(lists, buffer):
    """Read what shaders wrote through a copy, as `WorkLists.carry_shells` does."""
    copy = lists._ctx.buffer(reserve=buffer.size)
    lists._ctx.copy_buffer(copy, buffer)
    found = np.frombuffer(copy.read(), np.uint32)
    copy.release()
    return found


def entry_counts(lists):
    """Return the number of entries of every list."""
    counts = read_numbers(lists, lists._counts).reshape(-1, 4)[:, 3]
    return {key: int(counts[item.index]) for key, item in lists._lists.items()}


def entries_of(lists, key):
    """Return a list: rows of (row, column, chain), in any order."""
    first = lists._lists[key].first
    packed = read_numbers(lists, lists._entries)[first : first + entry_counts(lists)[key]]
    return np.stack([packed >> 14 & 0x3FFF, packed & 0x3FFF, packed >> 28], axis=-1)


def is_of_pass(item):
    """Tell whether an object may hold what a pass writes; shaders keep what they were told."""
    return type(item).__module__.startswith("pipeline.") and not isinstance(item, Shader)
