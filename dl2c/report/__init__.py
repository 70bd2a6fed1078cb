"""Looking at what happened: episodes as files, counterexamples, pictures, pages."""
