"""The dialect of KeYmaera X 4, recognised and for now refused.

In: the code of a file. Its reader will stand here: block headers and declarations that end with
`.`, sorts `R B P`, `Functions`, `SharedDefinitions`, files without an entry.
"""

import re

from dl2c.diagnostics import CompileError
from dl2c.parse import errors
from dl2c.parse.scan import Code
from dl2c.parse.sections import STRING

_STARTS_ENTRY = re.compile(r"(?<![A-Za-z0-9_])(?:ArchiveEntry|Theorem|Lemma|Exercise)(?![A-Za-z0-9_])")
_MARKS = (
    (r"(?<![A-Za-z0-9_\\])(?:Functions|Variables|SharedDefinitions)(?![A-Za-z0-9_])", "renamed since"),
    (
        r"(?<![A-Za-z0-9_\\])(?:Definitions|ProgramVariables|Problem)\s*[.;]",
        "no `.` or `;` follows a section word now",
    ),
    (r"(?<![A-Za-z0-9_])(?:ArchiveEntry|Theorem|Lemma|Exercise)\s+\0*\.", "no `.` follows the name now"),
    (
        r"(?:(?<=;)|(?<=\.)|(?<=\bDefinitions)|(?<=\bProgramVariables))\s*[RBPTF]\s+[A-Za-z]\w*\s*[(.;,=<:]",
        "sorts are `Real`, `Bool`, `HP` now",
    ),
    (r"(?<![A-Za-z0-9_(,])(?:Real|Bool|HP)\s+[A-Za-z]\w*\s*\.", "declarations end with `;` now"),
)


def refuse(code: Code) -> None:
    """Raise the error that names the first sign of the old dialect, if there is one."""
    text = re.sub(STRING, lambda s: "\0" * len(s.group()), code.text, flags=re.DOTALL)
    found = [(m, why) for pattern, why in _MARKS if (m := re.search(pattern, text))]
    if not _STARTS_ENTRY.search(text) and (
        m := re.search(r"(?<![A-Za-z0-9_])(?:Definitions|ProgramVariables|Problem)\b", text)
    ):
        found.append((m, 'a model starts with `ArchiveEntry "Name"` now'))
    if found:
        match, why = min(found, key=lambda pair: pair[0].start())
        start = match.end() - len(match.group().lstrip())
        raise CompileError(errors.old_dialect(code.span(start, match.end()), why))
