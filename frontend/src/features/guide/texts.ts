export type Platform = "hand" | "car" | "drone";

export interface Advice {
  label: string;
  good: string;
  bad: string;
  steps: readonly string[];
  /** What such a rig cannot show, and what to do about it. */
  limit: string;
}

/** What to do with each kind of rig; the numbers are those that the recording is judged by. */
export const guide: Readonly<Record<Platform, Advice>> = {
  hand: {
    label: "By hand",
    good: "Turned to and fro about all three axes, on the spot and while walking a few steps",
    bad: "Carried level through the room: it hardly turns, and the distance between the sensors stays unknown",
    steps: [
      "Stand in a room with bare walls, a floor and a ceiling, 1 to 10 m away from them.",
      "Hold still for two seconds: the noise of the IMU is measured then.",
      "For 30 to 60 seconds turn the rig briskly to and fro, as if drawing eights with its nose: about each axis at 30° a second or more, with quick reversals.",
      "Move it half a metre up, down and sideways between turns, and hold still once more at the end.",
    ],
    limit:
      "Keep people out of the room where you can, and yourself behind the rig: who walks is left out, but hides walls.",
  },
  car: {
    label: "On a car",
    good: "Eights at walking pace beside walls, over a ramp or a kerb, with brisk steering and braking",
    bad: "Straight ahead on level ground: roll and pitch never change, so height and two angles stay unknown",
    steps: [
      "Choose a yard, a garage or a car park with walls within 20 m on at least two sides.",
      "Stand still for two seconds with the engine running as in use.",
      "Drive eights as tight as the car can, both ways round, for 60 seconds, and brake and start briskly.",
      "Cross a ramp, a kerb or planks with one side and then with the other: that is the only roll and pitch it gets.",
    ],
    limit:
      "What level ground leaves open, most of all the height between the sensors, can be measured with a tape and given in Solve under “What is known”.",
  },
  drone: {
    label: "On a drone",
    good: "Short, brisk tilts forward, back and to the sides, with turns on the spot in between",
    bad: "A slow hover or a straight flight high up: little turning, and only the ground in sight",
    steps: [
      "Fly indoors, or 2 to 10 m from a building’s corner, so that walls and ground are in sight together.",
      "Stand still on the ground for two seconds with the motors off, then take off.",
      "For 30 to 60 seconds fly short, brisk dashes that tilt it to and fro, and turn on the spot both ways between them.",
      "Or hold the drone in your hands with the motors off and do as by hand: the answer is the same, without vibration.",
    ],
    limit: "Propellers shake the IMU; if the recording is called noisy, do it by hand.",
  },
};

/** The same for every rig, and the one thing that a later look at the recording cannot put right. */
export const pointTimes =
  "Let the lidar’s driver keep the time of each point; without them there is nothing to calibrate. Some need an option for it: RoboSense POINT_TYPE=XYZIRT, Livox xfer_format 1 or CustomMsg, Ouster point_type original.";

export const platforms: readonly Platform[] = ["hand", "car", "drone"];
