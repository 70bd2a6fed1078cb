"""Places as editors count them, and places of one text in a later one."""

from hypothesis import given
from hypothesis import strategies as st

from dl2c.lsp.positions import Encoding, Lines, Shift, normal

UNITS: dict[Encoding, int] = {"utf-8": 8 + 2 + 4, "utf-16": 8 + 1 + 2, "utf-32": 8 + 1 + 1}
TEXTS = st.text(alphabet="ab é😀\n\u2028")


def test_units_are_those_of_the_encoding() -> None:
    text = "first\nx := 1 é😀;\nlast"
    for encoding, units in UNITS.items():
        lines = Lines(text, encoding)
        assert lines.position(text.index(";")) == (1, units - 1)
        assert lines.offset((1, units - 1)) == text.index(";")
        assert lines.offset((1, 999)) == text.index("\nlast") and lines.offset((9, 0)) == len(text)


@given(text=TEXTS, encoding=st.sampled_from([*UNITS]))
def test_a_position_leads_back_to_its_offset(text: str, encoding: Encoding) -> None:
    lines = Lines(text, encoding)
    assert [lines.offset(lines.position(at)) for at in range(len(text) + 1)] == [*range(len(text) + 1)]


@given(before=TEXTS, old=TEXTS, new=TEXTS, after=TEXTS)
def test_what_did_not_change_is_found_again(before: str, old: str, new: str, after: str) -> None:
    first, second = before + old + after, before + new + after
    shift = Shift.between(first, second)
    for start in range(len(first)):
        for end in range(start + 1, len(first) + 1):
            moved = shift.later(start, end)
            assert 0 <= moved[0] <= moved[1] <= len(second)
            if not shift.touches(start, end):
                assert first[start:end] == second[slice(*moved)]
                assert shift.earlier(moved[1]) == end
    assert all(0 <= shift.earlier(at) <= len(first) for at in range(len(second) + 1))


def test_line_ends_and_a_mark_are_no_text() -> None:
    assert normal("\ufeffa\r\nb\rc\n") == " a\nb\nc\n"
