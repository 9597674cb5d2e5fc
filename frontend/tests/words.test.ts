import { describe, expect, it } from "vitest";
import { plain, spoken } from "../src/ui/words";

describe("the page's own words", () => {
  // Fails when a value is left behind, or when a word that is no value is taken for one.
  it("calls options what their controls are called", () => {
    expect(plain("it is not; pass --gyroscope-unit rad_s")).toBe("it is not; set “Gyroscope unit” to rad/s");
    expect(plain("name it with --point-time-field and --point-time-unit, or pass --synthesise-point-time.")).toBe(
      "name it with “Point time field” and “Point time unit”, or switch on “Make up point times”.",
    );
    expect(plain("start later with --start-s.")).toBe("start later with “Start of the span”.");
    expect(plain("or use --method full for honest ones")).toBe("or set “Method” to Full for honest ones");
    expect(plain("leave --point-time-reference out, or give header-first")).toBe(
      "leave “Point time counts from” out, or give header-first",
    );
    expect(plain("see `unsweep inspect`")).toBe("see the Recording screen");
  });

  // Fails when a path of the API's document reaches a person.
  it("calls fields by their names", () => {
    expect(
      plain("The request does not fit the API's document: body.settings.priors.0.std: Input should be greater than 0."),
    ).toBe("That cannot be used: priors, number 1, std: Input should be greater than 0.");
  });

  // Fails when a name of a topic or plane is taken for a sentence, or when an answer's shape changes.
  it("changes sentences and nothing else of an answer", () => {
    const answer = {
      name: "--stamps",
      text: "pass --stamps receive",
      n: [1, 2],
      planes: [{ reason: "--planes" }],
      reasons: ["use --stamps"],
      none: null,
    };
    expect(spoken(answer)).toEqual({
      name: "--stamps",
      text: "set “Stamps” to time of arrival",
      n: [1, 2],
      planes: [{ reason: "“Planes”" }],
      reasons: ["use “Stamps”"],
      none: null,
    });
  });
});
