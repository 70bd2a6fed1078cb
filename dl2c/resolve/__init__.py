"""From a parsed entry to an executable problem: every name bound, every definition expanded."""
