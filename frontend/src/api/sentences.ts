/** What the page reads out of the library's sentences, which have no fields for it: all such patterns, and nowhere else any.
 *  `tests/contract/test_sentences.py` holds each against the sentence as the library writes it today.
 */

/** Of what stands behind a plane's name: why a solve left it out. */
export const leftOut = /^(?:is )?(.*): left out$/;

/** Of what stands behind a plane's name: what is wrong with it, where it counts because a person chose it; results of older versions
 *  say it in other words. */
export const doubted = /^(?:is )?(.*?), (?:but is used because it was chosen|and counts all the same)/;

/** The planes that a refusal names, each with what is wrong with it, between its first colon and what follows from them. */
export const blamed = /: (.*?)(?:, and the others do not face three (?:different directions|ways))?(?:;|$)/;

/** What a prior was given for that the recording contradicts: a rotation or a translation and its axis; else the time offset. */
export const contradictedPrior = /given for the (?:(rotation|translation) \w+ the \w+['’]s ([xyz]) axis|time offset)/;

/** The sensor that has to be named for surer numbers. */
export const toBeNamed = /nam(?:e|ing) the (IMU|lidar)/;

/** Sentences about a sensor's readings, and among these the ones that cast doubt on their unit. That readings are in g is said of
 *  every such recording, and a bias that wanders many times as fast as others do is no unit: what is compared with the lidar is.
 */
export const ofGyroscope = /gyroscope/i;
export const gyroscopeUnitDoubted = /(?<!in )\bunits?\b|times as fast as the lidar/i;
export const ofAccelerometer = /acceler|gravity/i;
export const accelerometerUnitDoubted = /(?<!in )\bunits?\b|neither in m\/s² nor in g/i;
