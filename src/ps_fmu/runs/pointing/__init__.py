"""What the scenario ``pointing`` is made of: record of a run, the loop of its system, and how both are shown."""
