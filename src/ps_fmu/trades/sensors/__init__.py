"""Which accelerometer the isolator needs: residual jitter against noise, bias and high-pass frequency."""
