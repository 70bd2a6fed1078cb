"""The meaning of a model as data: terms, formulas, programs, flows, and the algebra of them."""
