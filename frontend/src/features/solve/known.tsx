import { ActionIcon, Button, NativeSelect, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { factsQuery } from "../../api/queries";
import { axes, unitOf, type Axis } from "../../ui/axes";
import { Icon } from "../../ui/icons";
import { priorField } from "./draft";
import { priorOf, type PriorText } from "./priors";
import css from "./solve.module.css";

interface PriorsProps {
  priors: readonly PriorText[];
  /** Whether the field of that name is the one that stands in the way. */
  wrong: (field: string) => boolean;
  onChange: (priors: PriorText[]) => void;
}

function isAxis(text: string): text is Axis {
  return (axes as readonly string[]).includes(text);
}

/** What is known of single axes beforehand, each with its standard deviation: a ruler's lever arm, a wired clock. */
export function Priors({ priors, wrong, onChange }: PriorsProps) {
  const names = useQuery(factsQuery).data?.axis_names ?? {};
  const set = (place: number, part: Partial<PriorText>) =>
    onChange(priors.map((prior, i) => (i === place ? { ...prior, ...part } : prior)));
  const free = axes.find((axis) => !priors.some((prior) => prior.axis === axis));
  return (
    <div className={css.priors} role="group" aria-label="What is known">
      {priors.map((prior, i) => (
        <div key={i} className={css.prior}>
          <NativeSelect
            size="xs"
            aria-label={`Axis of what is known, ${i + 1}`}
            value={prior.axis}
            data={axes.map((axis) => ({ value: axis, label: names[axis] ?? axis }))}
            onChange={(event) => {
              const { value } = event.currentTarget;
              if (isAxis(value)) set(i, { axis: value });
            }}
          />
          <TextInput
            size="xs"
            inputMode="decimal"
            name={priorField(i, "value")}
            error={wrong(priorField(i, "value"))}
            aria-label={`Value of ${names[prior.axis] ?? prior.axis}, ${unitOf(prior.axis)}`}
            placeholder={unitOf(prior.axis)}
            value={prior.value}
            onChange={(event) => set(i, { value: event.currentTarget.value })}
          />
          <span aria-hidden="true">±</span>
          <TextInput
            size="xs"
            inputMode="decimal"
            name={priorField(i, "sigma")}
            aria-label={`One standard deviation of ${names[prior.axis] ?? prior.axis}, ${unitOf(prior.axis)}`}
            placeholder={unitOf(prior.axis)}
            value={prior.sigma}
            error={
              wrong(priorField(i, "sigma")) || (prior.sigma !== "" && prior.value !== "" && priorOf(prior) === null)
            }
            onChange={(event) => set(i, { sigma: event.currentTarget.value })}
          />
          <span className="dim small">{unitOf(prior.axis)}</span>
          <ActionIcon
            size="sm"
            variant="subtle"
            color="gray"
            aria-label={`Forget ${names[prior.axis] ?? prior.axis}`}
            onClick={() => onChange(priors.filter((_, k) => k !== i))}
          >
            <Icon name="cross" size={12} />
          </ActionIcon>
        </div>
      ))}
      {free !== undefined && (
        <Button
          size="compact-xs"
          variant="default"
          onClick={() => onChange([...priors, { axis: free === "rx" ? "tz" : free, value: "", sigma: "" }])}
        >
          Add something known
        </Button>
      )}
    </div>
  );
}
