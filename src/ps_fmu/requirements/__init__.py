"""Requirements on pointing errors: read them from a file, judge them in a run or on stored rows, state verdicts."""
