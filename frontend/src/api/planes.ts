import { queryOptions, replaceEqualDeep, useMutation, useQueryClient, type MutationCache } from "@tanstack/react-query";
import { api, told, type Operation, type Planes } from "./client";
import { keys, of } from "./queries";

export const planesQuery = (id: string) =>
  queryOptions({
    queryKey: keys.planes(id),
    queryFn: () => told(api.GET("/api/recordings/{recording_id}/planes", of(id))),
    structuralSharing: newest,
  });

/** Of what is known and what has just come the newer: an answer may be overtaken by that of a later edit, and would undo it. */
export function newest(known: unknown, come: unknown): unknown {
  const [before, after] = [known as Planes | undefined, come as Planes];
  return before !== undefined && after.revision < before.revision ? before : replaceEqualDeep(before, after);
}

/** The planes as they will be after an operation, as far as that is plain. */
export function foreseen(planes: Planes, operation: Operation): Planes {
  if (operation.op !== "confirm" && operation.op !== "drop") return planes;
  const confirmed = operation.op === "confirm";
  const changes = planes.patches.some((patch) => patch.index === operation.index && patch.confirmed !== confirmed);
  if (!changes) return planes;
  const patches = planes.patches.map((patch) => (patch.index === operation.index ? { ...patch, confirmed } : patch));
  return { ...planes, patches, can_undo: true, can_redo: false };
}

/** What has been asked for and not been answered yet, oldest first. */
function waiting(cache: MutationCache, id: string): Operation[] {
  return cache
    .findAll({ mutationKey: keys.editing(id), status: "pending" })
    .map((mutation) => mutation.state.variables as Operation);
}

/** Edits of the planes; the answer is the new state of all of them. */
export function useEditPlanes(id: string) {
  const client = useQueryClient();
  return useMutation({
    mutationKey: keys.editing(id),
    // In the order they were asked for: an undo pressed at once undoes what is still on its way.
    scope: { id: `planes-${id}` },
    mutationFn: (operation: Operation) =>
      told(api.POST("/api/recordings/{recording_id}/planes/operations", { ...of(id), body: operation })),
    // A ticked box answers at once; the server's word follows, with the sentence on what is determined.
    onMutate: (operation) =>
      client.setQueryData<Planes>(keys.planes(id), (old) => (old === undefined ? old : foreseen(old, operation))),
    // What was ticked meanwhile stays ticked: its answer is still to come.
    onSuccess: (planes: Planes, operation) => {
      const later = waiting(client.getMutationCache(), id).filter((other) => other !== operation);
      client.setQueryData<Planes>(keys.planes(id), later.reduce(foreseen, planes));
    },
    onError: () => client.invalidateQueries({ queryKey: keys.planes(id) }),
  });
}
