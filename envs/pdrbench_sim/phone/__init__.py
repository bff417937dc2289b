"""The motion of a phone in the hand or in a pocket, and what its magnetometer measures."""
