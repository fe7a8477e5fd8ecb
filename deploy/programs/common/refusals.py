"""What the host programs say when they cannot go on."""

LONGEST = 600


class Refused(Exception):
    """What is wrong, in one line. `stage` is bundle, input, missing, start, run or result; `details` is a traceback,
    `output` what the vendor's software wrote."""

    output = ""

    def __init__(self, stage: str, text: str, details: str = "") -> None:
        super().__init__(plain(" ".join(text.split())))
        self.stage, self.details = stage, details


def plain(text: str) -> str:
    """What a terminal may be sent of ``text``: other characters as their escapes, and not the middle of a long one."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return shown if len(shown) <= LONGEST else shown[: LONGEST // 2] + "..." + shown[-LONGEST // 2 :]


def told(error: BaseException) -> str:
    """Kind and first 200 characters of an exception."""
    return " ".join((type(error).__name__ + ": " + str(error)).split())[:200]


def interrupt(number: int, frame: object) -> None:
    """A request to end, by Ctrl-C or from the program that started this one."""
    raise KeyboardInterrupt
