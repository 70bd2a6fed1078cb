"""Printed numbers are the numbers they stand for, with no digits too many."""

from fractions import Fraction

from hypothesis import example, given
from hypothesis import strategies as st

from dl2c.ir.printer import decimal_places, print_number

INTEGERS = st.integers(-(10**25), 10**25)
SHIFTED = st.tuples(INTEGERS, st.integers(0, 40), st.integers(0, 25))
DECIMALS = SHIFTED.map(lambda parts: Fraction(parts[0], 2 ** parts[1] * 5 ** parts[2]))
DOUBLES = st.floats(allow_nan=False, allow_infinity=False).map(Fraction)
NUMBERS = st.one_of(INTEGERS.map(Fraction), DECIMALS, DOUBLES, st.fractions())


@given(NUMBERS)
@example(Fraction(0))
@example(Fraction(-3))
@example(Fraction(-1, 20))
@example(Fraction(1, 7))
def test_a_printed_number_is_the_number(value: Fraction) -> None:
    """Those with many digits are printed as the double that they are."""
    text = print_number(value)
    assert Fraction(text) == value or ("/" not in text and Fraction(float(text)) == value)
    assert text == text.strip() and not text.startswith("+")


@given(NUMBERS)
def test_decimals_have_the_fewest_places(value: Fraction) -> None:
    places = decimal_places(value)
    if places is None:
        assert 10 ** value.denominator.bit_length() % value.denominator
        return
    assert (value * 10**places).denominator == 1
    assert places == 0 or (value * 10 ** (places - 1)).denominator != 1
