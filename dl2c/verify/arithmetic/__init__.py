"""Questions of real arithmetic: made polynomial, put to solvers, or evaluated exactly."""
