"""Pictures of episodes, as `plot=` annotations ask for. Matplotlib is imported when one is drawn."""
