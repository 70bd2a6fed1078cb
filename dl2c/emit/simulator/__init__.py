"""The C of an environment: control paths, flows, rewards, initial states."""
