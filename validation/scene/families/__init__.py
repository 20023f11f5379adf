"""Families of hexahedral blocks and files of blocks, one file each: found here, listed nowhere."""
