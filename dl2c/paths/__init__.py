"""The discrete part of a step as guarded paths between its cut points."""
