"""What the project measures with its own product: the paper, the studies, the benchmarks, the demo."""
