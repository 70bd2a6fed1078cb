"""Failures of building or calling native code that are not mistakes in a model."""


class NativeError(RuntimeError):
    """A compiled library cannot be built, loaded or called; the message says what to do."""


class PlatformUnsupported(NativeError):
    """Libraries cannot be built for this operating system."""


class CompilerMissing(NativeError):
    """No C compiler was found."""


class CompilerFailed(NativeError):
    """The C compiler rejected the generated code or could not write its output."""


class BatchClosed(NativeError, ValueError):
    """A call of environments that were closed."""


class BatchBusy(NativeError, ValueError):
    """A call of environments during another one, from another thread or from inside of it."""


class MonitorViolated(NativeError):
    """A step of a monitored simulator violates the monitor of its model. `environment` is its index in the
    batch, `condition` the number that the monitor gives it.
    """

    def __init__(self, message: str, environment: int, condition: int) -> None:
        super().__init__(message)
        self.environment, self.condition = environment, condition

    def __reduce__(self) -> tuple[type["MonitorViolated"], tuple[str, int, int]]:
        return MonitorViolated, (str(self), self.environment, self.condition)


class ResetFailed(NativeError):
    """No admissible initial state: none was drawn in the allowed number of tries, or the given one is not."""
