"""What an assembly has beside its blocks: regions, supports, pairs, balance, measures, options."""
