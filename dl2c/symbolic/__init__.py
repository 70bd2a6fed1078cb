"""IR terms and formulas as CasADi graphs, and those as instruction tapes."""
