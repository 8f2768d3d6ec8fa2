-- Pairs of address and name with which somebody has signed in at any instance of a cluster: others
-- cannot keep them out by tries under the name. They need not outlive the server.
CREATE UNLOGGED TABLE sign_in_pair (
    pair TEXT COLLATE "C" PRIMARY KEY,
    right_at_ns BIGINT NOT NULL
);
CREATE INDEX sign_in_pair_right_at ON sign_in_pair (right_at_ns);
INSERT INTO schema_compatible (version, oldest) VALUES (20261125100000, 20261124160000);
