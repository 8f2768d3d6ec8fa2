-- Ties a row to all rows before it: SHA-256 over the link of the row before and the row's content.
-- Rows of versions before this one have none.
ALTER TABLE audit ADD COLUMN link TEXT;
