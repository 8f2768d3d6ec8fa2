-- Whom an instance hears on Zenoh, while it does not hear every other one: where the routers are cut from
-- each other, robots go to an instance at their side of the cut.
ALTER TABLE instance
    ADD COLUMN unheard_instances TEXT[] NOT NULL DEFAULT '{}',
    ADD COLUMN heard_robots TEXT[] NOT NULL DEFAULT '{}',
    ADD COLUMN unheard_robots TEXT[] NOT NULL DEFAULT '{}';
INSERT INTO schema_compatible (version, oldest) VALUES (20261128110000, 20261124160000);
