-- Which programs may use a schema. From here on each migration adds its row: `oldest` is the newest
-- migration of the oldest program that may serve the database afterwards. A migration that only adds
-- lets it stand; one that takes away what an older program needs raises it.
CREATE TABLE schema_compatible (
    version BIGINT PRIMARY KEY,
    oldest BIGINT NOT NULL,
    CHECK (oldest <= version)
);
INSERT INTO schema_compatible (version, oldest) VALUES (20261124160000, 20261124160000);
