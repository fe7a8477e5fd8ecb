"""What the host programs say when they cannot go on."""


class Refused(Exception):
    """What is wrong, in one line. `stage` is bundle, input, missing, start, run or result; `details` is a traceback,
    `output` what the vendor's software wrote."""

    output = ""

    def __init__(self, stage: str, text: str, details: str = "") -> None:
        super().__init__(" ".join(text.split()))
        self.stage, self.details = stage, details


def told(error: BaseException) -> str:
    """Kind and first 200 characters of an exception."""
    return " ".join((type(error).__name__ + ": " + str(error)).split())[:200]


def interrupt(number: int, frame: object) -> None:
    """A request to end, by Ctrl-C or from the program that started this one."""
    raise KeyboardInterrupt
