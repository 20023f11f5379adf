"""The contact law, friction, and the surfaces on which blocks meet."""
