"""The one exception for a user's mistake outside the image pipeline."""


class StudyError(Exception):
    """A mistake the user can mend: bad file, protocol, folder, device or key.

    The message says what must hold, what was found, where, and the cure. The
    command line prints it without a traceback and exits with status 2.
    """
