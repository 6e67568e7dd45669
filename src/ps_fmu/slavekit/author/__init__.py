"""What the author of a slave uses: base class, ports, buffer, state, native steps, model description."""
