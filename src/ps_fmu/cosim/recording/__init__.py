"""What becomes of the rows of a run: handed to observers, selected, thinned, stored."""
