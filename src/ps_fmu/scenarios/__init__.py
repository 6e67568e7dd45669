"""What is asked of a run: the scenarios of the product, what they record, compare and show."""
