import type { QueryClient, QueryFilters } from "@tanstack/react-query";

/**
 * Read something again that has just changed, whoever is still waiting for the first answer about it.
 *
 * Invalidating alone lets a first request that is on its way go on, and takes its answer, from before the change, for the newest.
 */
export async function readAnew(client: QueryClient, which: QueryFilters): Promise<void> {
  await client.cancelQueries(which);
  await client.invalidateQueries(which);
}
