-- Rows of the series that tell of blocks: so many are fitted. NULL in rows of the networks of the whole.
ALTER TABLE metrics ADD COLUMN blocks INTEGER;
