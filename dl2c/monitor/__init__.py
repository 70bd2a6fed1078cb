"""What a run-time monitor checks: conditions over a state before and a state after."""
