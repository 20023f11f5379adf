"""Contacts of rigid blocks: velocities of gaps by motions, and supports that take motions."""
