"""From the step model to readable C."""
