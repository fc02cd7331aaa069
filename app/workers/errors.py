"""Why there is no answer to a job, other than that its mesh cannot be used (``model.errors``)."""


class WorkerLostError(Exception):
    """The worker died on the job, and so did the next one."""


class TookTooLongError(Exception):
    """A stage of the job took longer than it may; the message names it."""


class OutOfMemoryError(Exception):
    """The job needs more memory than a worker may have."""


class DefectError(Exception):
    """The worker met an exception that nothing expects, or cannot be trusted; the message is for the log alone."""
