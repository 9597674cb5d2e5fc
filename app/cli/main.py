"""The command line `unsweep`: words in, a command run, every error turned into an exit code and one sentence.

Exit codes: 0 done; 1 an audited extrinsic is off; 2 the call or the input is at fault; 3 the recording cannot give the
answer; 4 a defect; 130 interrupted. On 2, 3 and 4 the last line on stderr is one sentence (docs/contract.md).
"""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType

from app.cli.commands import COMMANDS, AuditFailed, Refused
from app.cli.parser import build_parser
from app.cli.usage import UsageError
from app.process import forget_stdout, keep_freed_memory, leave, say_nothing_of_numbers
from calib_core.errors import Cancelled, InputError, is_for_want_of_room

EXIT_DONE, EXIT_FAILED, EXIT_INPUT, EXIT_REFUSED, EXIT_DEFECT, EXIT_INTERRUPTED = 0, 1, 2, 3, 4, 130

FULL_DISK = (
    "Expected room for what is written, but the disk is full; free some space, choose another place for the output, or point "
    "TMPDIR at a disk with room for what is kept meanwhile."
)


def main() -> None:
    """The console script."""
    signal.signal(signal.SIGTERM, _interrupt)
    if sys.argv[1:2] == ["serve"]:
        sys.exit(run(sys.argv[1:]))
    keep_freed_memory()
    say_nothing_of_numbers()
    leave(run(sys.argv[1:]))


def run(arguments: Sequence[str]) -> int:
    """Run the command in `arguments`; its exit code. Whatever happens, no traceback is shown."""
    log_json = "--log-json" in arguments
    try:
        chosen = build_parser().parse_args(_attach_negative_values(arguments))
        COMMANDS[chosen.command](chosen)
        sys.stdout.flush()
    except SystemExit as leaving:  # argparse, after --help and --version
        return EXIT_DONE if leaving.code is None else int(leaving.code)
    except (AuditFailed, Refused) as refused:
        exit_code = EXIT_FAILED if isinstance(refused, AuditFailed) else EXIT_REFUSED
        return _fail(exit_code, refused.code, str(refused), log_json=log_json)
    except (KeyboardInterrupt, Cancelled) as stopped:
        # Ctrl-C comes without words; a command that leaves something behind says what.
        text = (isinstance(stopped, KeyboardInterrupt) and str(stopped)) or "Interrupted; nothing was written."
        return _fail(EXIT_INTERRUPTED, "interrupted", text, log_json=log_json)
    except UsageError as error:
        return _fail(EXIT_INPUT, "usage", str(error), log_json=log_json)
    except InputError as error:
        return _fail(EXIT_INPUT, error.code, _with_notes(str(error), error), log_json=log_json)
    except BrokenPipeError:
        # Whoever read our output has what they wanted.
        forget_stdout()
        return EXIT_DONE
    except Exception as error:  # noqa: BLE001  the last stop before a traceback would reach a user
        return _fail_unexpectedly(error, log_json=log_json)
    return EXIT_DONE


def _fail_unexpectedly(error: Exception, *, log_json: bool) -> int:
    """What nobody has made a sentence of: a disk that is full, met wherever something is written, or a defect."""
    if not is_for_want_of_room(error):
        return _fail(EXIT_DEFECT, "defect", _with_notes(_defect_sentence(error), error), log_json=log_json)
    try:
        sys.stdout.flush()
    except OSError:  # it is what took no more
        forget_stdout()
    return _fail(EXIT_INPUT, "disk.full", _with_notes(FULL_DISK, error), log_json=log_json)


def _attach_negative_values(arguments: Sequence[str]) -> list[str]:
    """`--mounting -0.1,0,...` as `--mounting=-0.1,0,...`: argparse takes the former for another option."""
    attached: list[str] = []
    for word in arguments:
        number_follows = len(word) > 1 and word[0] == "-" and (word[1].isdigit() or word[1] == ".")
        if number_follows and attached and attached[-1].startswith("--") and "=" not in attached[-1]:
            attached[-1] += f"={word}"
        else:
            attached.append(word)
    return attached


def _fail(exit_code: int, code: str, text: str, *, log_json: bool) -> int:
    """Say the one sentence, as the last line on stderr."""
    sentence = " ".join(text.split())
    sentence = sentence[:1].upper() + sentence[1:].rstrip(".") + "."
    line = json.dumps({"event": "error", "code": code, "text": sentence}) if log_json else f"unsweep: {sentence}"
    with suppress(OSError):  # nobody reads it any more, or it takes no more
        sys.stderr.write(line + "\n")
        sys.stderr.flush()
    return exit_code


def _with_notes(text: str, error: Exception) -> str:
    """The sentence, and behind it what a command has noted on the error: what stays in spite of it."""
    return "; ".join([text.strip().rstrip("."), *getattr(error, "__notes__", [])])


def _defect_sentence(error: Exception) -> str:
    """What to tell of an unexpected exception; its traceback goes to a file."""
    name = type(error).__name__
    try:
        descriptor, path = tempfile.mkstemp(prefix="unsweep-", suffix=".log")
        with os.fdopen(descriptor, "w", encoding="utf-8") as log:
            log.write(f"unsweep {' '.join(sys.argv[1:])}\n")
            log.write("".join(traceback.format_exception(error)))
    except OSError:
        return f"A defect in unsweep stopped it ({name}: {error}); please report it with the command you gave."
    return f"A defect in unsweep stopped it ({name}); please report it with the details it left in {path}."


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    """Being asked to end is the same as Ctrl-C: clean up, write nothing. Asked again, as `timeout` does, it is under way."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
