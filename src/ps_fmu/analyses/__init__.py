"""What analyses have in common: the table of them, their options, their results, and jobs in other processes.

It knows neither the paper nor the trades: the table names them in text.
"""
