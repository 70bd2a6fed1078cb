"""Whether the theorem that a model states is proved: obligations, rules, refutations, report."""
