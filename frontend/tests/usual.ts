import type { Usual } from "../src/api/client";

/** Numbers as a server may tell them: none of them what a page could have by itself. */
export const usual: Usual = {
  max_rounds: 14,
  paper_points_per_plane_per_scan: 90,
  paper_field_of_view_deg: 50,
  latitude_gravity_std_m_s2: 0.004,
  shortest_span_s: 1.5,
  merge_within_deg: 10,
  merge_within_m: 0.5,
  smallest_points: 0.5,
  largest_points: 3,
};
