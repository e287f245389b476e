"""Files: the only folder that opens files; readers by suffix, results, run folders."""
