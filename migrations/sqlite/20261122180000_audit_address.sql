-- Where the request came from: the client's address, behind a trusted proxy the one that it names.
ALTER TABLE audit ADD COLUMN address TEXT;
