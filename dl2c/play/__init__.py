"""Pages in which a model is driven by hand: its C as WebAssembly, with all that shows and steers it."""
