"""Parameter studies: many scenes, each with a row of answers, computed with Dask and stored as Parquet."""
