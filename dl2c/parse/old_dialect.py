"""The dialect of KeYmaera X 4, read like that of 5 and warned about.

In: the code of a file. Out: a warning at the first sign of the dialect: block headers and
declarations that end with `.`, sorts `R B P T F`, `Functions`, `SharedDefinitions`, names of
entries that end with `.`, and files without an entry.
"""

import re

from dl2c.diagnostics import Diagnostic
from dl2c.parse import errors
from dl2c.parse.scan import Code
from dl2c.parse.sections import STRING

OLD_SORT = r"[RBPTF](?=\s+[A-Za-z])"
"""A sort of this dialect, where a declaration may begin; also a legal name elsewhere."""

_STARTS_ENTRY = re.compile(r"(?<![A-Za-z0-9_])(?:ArchiveEntry|Theorem|Lemma|Exercise)(?![A-Za-z0-9_])")
_SIGNS = (
    (r"(?<![A-Za-z0-9_\\])(?:Functions|Variables|SharedDefinitions)(?![A-Za-z0-9_])", "renamed since"),
    (
        r"(?<![A-Za-z0-9_\\])(?:Definitions|ProgramVariables|Problem)\s*[.;]",
        "no `.` or `;` follows a section word now",
    ),
    (r"(?<![A-Za-z0-9_])(?:ArchiveEntry|Theorem|Lemma|Exercise)\s+\0+\s*\.", "no `.` follows the name now"),
    (
        rf"(?:(?<=[;.])|(?<=\bDefinitions)|(?<=\bProgramVariables))\s*{OLD_SORT}",
        "sorts are `Real`, `Bool`, `HP` now",
    ),
    (r"(?<![A-Za-z0-9_(,])(?:Real|Bool|HP)\s+[A-Za-z]\w*\s*\.", "declarations end with `;` now"),
)


def find_sign(code: Code) -> Diagnostic | None:
    """The warning at the first sign of the old dialect, if there is one."""
    text = re.sub(STRING, lambda s: "\0" * len(s.group()), code.text, flags=re.DOTALL)
    found = [(m, why) for pattern, why in _SIGNS if (m := re.search(pattern, text))]
    if not _STARTS_ENTRY.search(text) and (
        m := re.search(r"(?<![A-Za-z0-9_])(?:Definitions|ProgramVariables|Problem)\b", text)
    ):
        found.append((m, 'a model starts with `ArchiveEntry "Name"` now'))
    if not found:
        return None
    match, why = min(found, key=lambda pair: pair[0].start())
    start = match.end() - len(match.group().lstrip())
    return errors.old_dialect(code.span(start, match.end()), why)
