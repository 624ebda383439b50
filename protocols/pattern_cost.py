"""Patterns whose search takes longer and longer with every character of a line that does not match.

A pattern such as `([0-9]+)+` tries every way to cut a row of digits: twice as many with each digit. A damaged line
would hold up the process that watches the rig.
"""

from __future__ import annotations

import re
import time

MOST_S = 0.02
LONGEST_ROW = 48
LETTERS = "1 .-A;"
REPEATED_GROUP = re.compile(r"\)[*+{]")


def explodes(pattern: str, line: str) -> bool:
    """Whether there is a line over which the pattern takes longer than it may.

    Rows of one letter are put behind every beginning of a line that matches, longer ones step by step, and a NUL.

    Args:
        pattern: regular expression of a whole line.
        line: one that matches.
    """
    if REPEATED_GROUP.search(pattern) is None:
        return False
    regex = re.compile(pattern, re.ASCII)
    for end in range(len(line) + 1):
        for letter in {line[end - 1 : end] or "0", *LETTERS}:
            for count in range(4, LONGEST_ROW, 2):
                begin_s = time.thread_time()
                regex.fullmatch(f"{line[:end]}{letter * count}\0")
                if time.thread_time() - begin_s > MOST_S:
                    return True
    return False
