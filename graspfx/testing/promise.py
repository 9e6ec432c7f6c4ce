"""A promise while it is put to the test, and the error that names the one that was broken."""

from __future__ import annotations

from types import TracebackType

from graspfx.errors import GraspFXError


class ConformanceError(GraspFXError, AssertionError):
    """A device or a scene that does not keep a promise: which promise, and what was found."""

    def __init__(self, promise: str, found: str, subject: str = "device") -> None:
        self.promise, self.found = promise, found
        super().__init__(f"the {subject} does not keep its promise: {promise}; found: {found}")


class Promise:
    """A promise while it is put to the test: an error that it does not speak of breaks it too.

    Args:
        text: what is promised.
        subject: who promises it.
        record: texts of promises that held, to which this one is added if it does.
    """

    def __init__(self, text: str, subject: str = "device", record: list[str] | None = None) -> None:
        self.text, self.subject, self._record = text, subject, record

    def __enter__(self) -> Promise:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if isinstance(error, Exception) and not isinstance(error, ConformanceError):
            raise ConformanceError(self.text, f"{type(error).__name__}: {error}", self.subject) from error
        if error is None and self._record is not None and self.text not in self._record:
            self._record.append(self.text)

    def holds(self, outcome: object, finding: str) -> None:
        if not outcome:
            raise ConformanceError(self.text, finding, self.subject)


class Promises:
    """Promises put to the test one after another, of which those that hold are noted.

    Attributes:
        texts: of the promises that held, in their order.
    """

    def __init__(self, subject: str) -> None:
        self._subject = subject
        self.texts: list[str] = []

    def __call__(self, text: str) -> Promise:
        """Put a promise to the test, in a `with` statement."""
        return Promise(text, self._subject, self.texts)
