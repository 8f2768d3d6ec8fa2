/** Site, vehicle type and tags of a robot, as a person types them. The service checks them. */

import type { RobotConfig } from '../api/types';

/** Typed groups of a robot; tags are separated by commas. */
export interface TypedGroups {
  site: string;
  vehicle_type: string;
  tags: string;
}

/** Returns the keys of a configuration that typed groups give; empty ones are left out. */
export function groupsOf(typed: TypedGroups): Pick<RobotConfig, 'site' | 'vehicle_type' | 'tags'> {
  const [site, vehicle_type] = [typed.site.trim(), typed.vehicle_type.trim()];
  const tags = typed.tags.split(',').map((tag) => tag.trim());
  const named = tags.filter((tag) => tag !== '');
  return {
    ...(site === '' ? {} : { site }),
    ...(vehicle_type === '' ? {} : { vehicle_type }),
    ...(named.length === 0 ? {} : { tags: named }),
  };
}
