"""Parameter studies: many scenes, each a row of answers, computed on Dask and kept as Parquet."""
