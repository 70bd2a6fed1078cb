"""From a resolved problem to the step model."""
