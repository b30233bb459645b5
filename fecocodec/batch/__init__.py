"""Encode or decode many scenes, in one process or on a Dask cluster; resumable. See `docs/batch.md`."""
