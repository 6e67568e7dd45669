"""An independent nonlinear multibody prototype of bus, legs and payload, to judge the plant by (extra `verify`)."""
