"""Questions of design that the paper does not ask: what to buy, and how to set it.  Found as analyses."""
